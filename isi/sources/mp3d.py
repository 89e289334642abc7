"""Observations of Matterport3D's objects in rooms, with AI2-THOR's names (section 6.3)."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from isi import config
from isi.columns import COUNT
from isi.config import Section
from isi.sources import Mining, Observation, reader
from isi.sources.names import AT_LOCATION, household
from isi.sources.readers import check_names, check_settings, read_table, refuse
from isi.tables import paths

#: Descriptions of counts: the instances that remain after each step.
STEPS = ("instances", "of a category and in a region", "in AI2-THOR's rooms", "without structure")
#: Scene and instance (None in published tallies), region and category (empty if unknown), and the
#: number of objects.
Tally = tuple[str | None, str | None, str, str, int]
#: Setting: room by type of region; other regions are omitted.
Rooms = Annotated[dict[str, str], Field(min_length=1)]


class Categories(Section):
    """Categories to omit (``structure``), and AI2-THOR's name of a category where
    it differs (``same_as``).
    """

    structure: list[str]
    same_as: dict[str, str]

    @field_validator("same_as")
    @classmethod
    def _not_structure(cls, value: dict[str, str], validation: ValidationInfo) -> dict[str, str]:
        if both := set(value) & set(validation.data.get("structure", ())):
            raise ValueError(f"expected {min(both)!r} in structure or in same_as, not in both")
        return value


@reader("mp3d_tallies", household)
def mp3d_tallies(mining: Mining, rooms: Rooms, vocabulary: str) -> Iterator[Observation]:
    """Observations from published tallies; ``rooms``: room by type of region;
    ``vocabulary``: path of a YAML file.
    """
    return mine([read_tallies(paths.MP3D_TALLIES, rooms)], rooms, Path(vocabulary), mining.counts)


def mine(
    batches: Iterable[Iterable[Tally]],
    rooms: Mapping[str, str],
    vocabulary: Path,
    counts: Counter[str],
) -> Iterator[Observation]:
    """Observations of batches of tallies (a house is a batch);
    equal observations of a batch become one row.

    Adds to ``counts`` the instances that remain after each of ``STEPS``. ``vocabulary`` is a file,
    not part of params, since DVC parses all params for every stage.
    """
    words = config.check(config.read(vocabulary), Categories, "", vocabulary)
    for batch in batches:
        observed = Counter[tuple[str | None, str, str | None, str]]()
        for scene, instance, region, category, count in batch:
            kept = True, bool(region and category), region in rooms, category not in words.structure
            for step, left in zip(STEPS, accumulate(kept, min), strict=True):
                counts[step] += count * left
            if all(kept):
                observed[scene, rooms[region], instance, words.same_as.get(category, category)] += (
                    count
                )
        for (scene, room, instance, head), count in observed.items():
            yield scene, room, instance, head, AT_LOCATION, room, count


def category_name(category: str) -> str:
    """Lower-case words of a category: ``chest_of_drawers`` and
    ``Chest#of#drawers`` → ``chest of drawers``.
    """
    return " ".join(re.sub("[#_]", " ", category).lower().split())


def read_tallies(path: Path, regions: Iterable[str]) -> Iterator[Tally]:
    """Tallies from a CSV ``object,room,count``;
    InputError if one of ``regions`` is not in the column ``room``.
    """
    table = read_table(path, ["object", "room", COUNT])
    table["object"] = table["object"].map(category_name)
    check_names(table, path)
    refuse(
        path,
        table["object"],
        table.duplicated(["object", "room"]),
        "expected each category once per room",
    )
    check_settings(path, "room", regions, table["room"])
    return (
        (None, None, room, name, count)
        for name, room, count in table.itertuples(index=False, name=None)
    )
