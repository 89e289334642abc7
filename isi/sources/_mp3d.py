"""Matterport3D's objects by room, however they were counted, in the words of another source (section 6.3)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pyarrow as pa
from pydantic import Field, ValidationInfo, field_validator

from isi import config
from isi.config import Section
from isi.sources import part
from isi.sources._household import AT_LOCATION

#: What is left after each step of mining.
STEPS = ("instances", "of a category and in a region", "in AI2-THOR's rooms", "without structure")
#: A setting: room of each type of region; other regions are left out.
Rooms = Annotated[dict[str, str], Field(min_length=1)]


@dataclass(frozen=True)
class Counted:
    """Objects of one category in one region: an instance of a house, or a tally."""

    scene: str | None
    instance: str | None
    #: type or label of the region; null where the object is in none
    region: str | None
    #: null where the object is of none
    category: str | None
    count: int


class Vocabulary(Section):
    """Which categories are left out, and what AI2-THOR calls those that it has under another name."""

    structure: list[str]
    same_as: dict[str, str]

    @field_validator("same_as")
    @classmethod
    def _not_structure(cls, value: dict[str, str], given: ValidationInfo) -> dict[str, str]:
        both = set(value) & set(given.data.get("structure", ()))
        if both:
            raise ValueError(f"{min(both)!r} is in structure, too")
        return value


def read_vocabulary(path: Path) -> Vocabulary:
    """The vocabulary in a YAML file; it is no setting itself, since DVC parses the params once a stage.

    Raises:
        InputError: where the file is missing or no YAML, or does not hold what a vocabulary does.
    """
    return config.check(config.read(path), Vocabulary, "", path)


def mine(
    batches: Iterable[Sequence[Counted]], rooms: Mapping[str, str], words: Vocabulary, left: Counter[str]
) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per batch, with equal ones added up.

    Args:
        batches: what was seen, for example in one house; only one is held at once.
        rooms: of each type of region; other regions are left out.
        words: what is left out, too, and the names of what is not.
        left: grows, as batches go by, by the instances that are left after each of ``STEPS``.
    """
    for batch in batches:
        placed = [seen for seen in batch if seen.region is not None and seen.category is not None]
        in_rooms = [seen for seen in placed if seen.region in rooms]
        objects = [seen for seen in in_rooms if seen.category not in words.structure]
        for step, kept in zip(STEPS, (batch, placed, in_rooms, objects), strict=True):
            left[step] += sum(seen.count for seen in kept)
        yield _table(objects, rooms, words)


def _table(objects: Sequence[Counted], rooms: Mapping[str, str], words: Vocabulary) -> pa.Table:
    counts: Counter[tuple[str | None, str, str | None, str]] = Counter()
    for seen in objects:
        region, category = str(seen.region), str(seen.category)
        counts[seen.scene, rooms[region], seen.instance, words.same_as.get(category, category)] += seen.count
    return part(
        [
            (scene, room, instance, head, AT_LOCATION, room, count)
            for (scene, room, instance, head), count in counts.items()
        ]
    )


def entity_name(category: str) -> str:
    """Lower-case words of a category: ``chest_of_drawers`` and ``Chest#of#drawers`` → ``chest of drawers``."""
    return " ".join(re.sub("[#_]", " ", category).lower().split())
