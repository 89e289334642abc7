"""Matterport3D's objects by room, however they were counted, in the words of another source (section 6.3)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import pyarrow as pa
from pydantic import AfterValidator, Field, ValidationInfo

from isi.sources import part
from isi.sources._household import AT_LOCATION

#: What is left after each step of mining.
STEPS = ("instances", "of a category and in a region", "in AI2-THOR's rooms", "without structure")


def _not_structure(same_as: dict[str, str], given: ValidationInfo) -> dict[str, str]:
    both = set(same_as) & set(given.data.get("structure", ()))
    if both:
        raise ValueError(f"{min(both)!r} is in structure, too")
    return same_as


#: Settings: room of each type of region, and other names of categories (which come after ``structure``).
Rooms = Annotated[dict[str, str], Field(min_length=1)]
SameAs = Annotated[dict[str, str], AfterValidator(_not_structure)]


@dataclass(frozen=True)
class Seen:
    """Objects of one category in one region: an instance of a house, or a tally."""

    scene: str | None
    instance: str | None
    #: type or label of the region; null where the object is in none
    region: str | None
    #: null where the object is of none
    category: str | None
    count: int


@dataclass(frozen=True)
class Vocabulary:
    """What the other source calls things; regions that are none of its rooms are left out, and so is structure."""

    rooms: Mapping[str, str]
    structure: Collection[str]
    same_as: Mapping[str, str]


def mine(batches: Iterable[Sequence[Seen]], words: Vocabulary, left: Counter[str]) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per batch, with equal ones added up.

    Args:
        batches: what was seen, for example in one house; only one is held at once.
        words: its names in AI2-THOR's words.
        left: grows, as batches go by, by the instances that are left after each of ``STEPS``.
    """
    for batch in batches:
        placed = [seen for seen in batch if seen.region is not None and seen.category is not None]
        in_rooms = [seen for seen in placed if seen.region in words.rooms]
        objects = [seen for seen in in_rooms if seen.category not in words.structure]
        for step, kept in zip(STEPS, (batch, placed, in_rooms, objects), strict=True):
            left[step] += sum(seen.count for seen in kept)
        yield _table(objects, words)


def _table(objects: Sequence[Seen], words: Vocabulary) -> pa.Table:
    counts: Counter[tuple[str | None, str, str | None, str]] = Counter()
    for seen in objects:
        region, category = str(seen.region), str(seen.category)
        counts[seen.scene, words.rooms[region], seen.instance, words.same_as.get(category, category)] += seen.count
    return part(
        [
            (scene, room, instance, head, AT_LOCATION, room, count)
            for (scene, room, instance, head), count in counts.items()
        ]
    )


def entity_name(category: str) -> str:
    """Lower-case words of a category: ``chest_of_drawers`` and ``Chest#of#drawers`` → ``chest of drawers``."""
    return " ".join(re.sub("[#_]", " ", category).lower().split())
