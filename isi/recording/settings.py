"""What to record, and with which player: the section ``recorder`` of params."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator

from isi.config import Count, Positive, Section, Seed, distinct
from isi.sources._recording import ITHOR, ROBOTHOR, layout

#: Builds that the package ``ai2thor`` downloads.
PLATFORMS = ("CloudRendering", "Linux64", "OSXIntel64")
#: Scenes that go by one word.
GROUPS = {
    "ithor": [name for plans in ITHOR for name in plans.names],
    "robothor": [name for plans in ROBOTHOR for name in plans.names],
}
_PLAN = re.compile(r"([A-Za-z]\w{0,98}?)([0-9]{1,6})(?:-([0-9]{1,6}))?", re.ASCII)

_Name = Annotated[str, Field(min_length=1)]


class Layout(NamedTuple):
    """A floor plan, as it is built (null) or with its objects placed anew by a seed."""

    plan: str
    spawn: int | None

    @property
    def name(self) -> str:
        return layout(self.plan, self.spawn)


class Recorder(Section):
    """How ``make record`` drives the simulator."""

    scenes: list[str]
    #: of each floor plan: null as it is built, a number as ``InitialRandomSpawn`` with this seed leaves it
    spawns: list[Seed | None]
    output: _Name
    #: one of ``PLATFORMS``, or the path of a local build
    platform: _Name
    #: commit of the build to download; null: the package's own
    build: Annotated[str, Field(pattern=r"^[0-9a-f]{40}$")] | None
    #: of a frame, which is square (pixels)
    width: Count
    server: Literal["wsgi", "fifo"]
    #: times that a scene is tried again when the player has died
    retries: Annotated[int, Field(ge=0)]
    #: for an action, and for the start (s)
    seconds: Positive
    start_seconds: Positive

    @field_validator("scenes")
    @classmethod
    def _are_floor_plans(cls, value: list[str]) -> list[str]:
        if not value or not distinct(plan for item in value for plan in plans(item)):
            raise ValueError("expected floor plans, none of them twice")
        return value

    @field_validator("spawns")
    @classmethod
    def _are_layouts(cls, value: list[int | None]) -> list[int | None]:
        if not value or not distinct(value):
            raise ValueError("expected null or seeds, none of them twice")
        return value

    @property
    def layouts(self) -> list[Layout]:
        """All that is to be recorded, in order."""
        return [Layout(plan, spawn) for item in self.scenes for plan in plans(item) for spawn in self.spawns]

    @property
    def executable(self) -> Path | None:
        """The local build; null where one is downloaded."""
        return None if self.platform in PLATFORMS else Path(self.platform)


def plans(item: str) -> Iterator[str]:
    """Floor plans that one item lists: those of a group, one by its name, or a range such as ``FloorPlan201-230``.

    Raises:
        ValueError: where it does neither.
    """
    if item in GROUPS:
        yield from GROUPS[item]
        return
    found = _PLAN.fullmatch(item)
    if not found or (found[3] and int(found[3]) < int(found[2])):
        groups = ", ".join(GROUPS)
        raise ValueError(f"expected {groups}, a floor plan or a range such as FloorPlan1-30, got {item[:80]!r}")
    for number in range(int(found[2]), int(found[3] or found[2]) + 1):
        yield f"{found[1]}{number}"
