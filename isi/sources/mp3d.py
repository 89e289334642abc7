"""Matterport3D's objects by room, from published tallies or from its own houses, in AI2-THOR's words (section 6.3)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationInfo, field_validator

from isi import config
from isi.config import Section
from isi.errors import InputError, short
from isi.sources import Mining, Observation, reader
from isi.sources.names import AT_LOCATION, check_name, household, name_fault
from isi.sources.readers import read_table, read_text
from isi.tables import paths

#: What is left after each step of mining.
STEPS = ("instances", "of a category and in a region", "in AI2-THOR's rooms", "without structure")
#: Where a record ``C`` of a house has the name of its category.
CATEGORY_FIELD = {"category_mapping_name": 3, "mpcat40": 5}
#: Kinds of records as a house's header counts them, in its order; panoramas and portals are both ``P``.
HEADERS = {"1.0": "IPVSRL", "1.1": "IPVSEOCRPL"}
RECORD_KINDS = {
    "I": "images", "P": "panoramas and portals", "V": "vertices", "S": "surfaces", "E": "segments", "O": "objects",
    "C": "categories", "R": "regions", "L": "levels",
}  # fmt: skip
#: Settings: room of each type of region, or of each label of a region in a house; other regions are left out.
Rooms = Annotated[dict[str, str], Field(min_length=1)]
HouseRooms = Annotated[dict[Annotated[str, Field(pattern=r"^[a-pr-zBCDSZ]$")], str], Field(min_length=1)]
Category = Literal["category_mapping_name", "mpcat40"]
T = TypeVar("T")


@dataclass(frozen=True)
class Tally:
    """Objects of one category in one region: an instance of a house, or a published count."""

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


@reader("mp3d_tallies", household)
def mp3d_tallies(mining: Mining, rooms: Rooms, vocabulary: str) -> Iterator[Observation]:
    """Observations of objects in rooms, from published tallies.

    Args:
        mining: counts what is left after each step.
        rooms: room of each type of region; other regions are left out.
        vocabulary: path of the file that says which categories are left out, and which have another name.
    """
    words = read_vocabulary(Path(vocabulary))
    return mine([read_tallies(paths.MP3D_TALLIES, rooms)], rooms, words, mining.counts)


@reader("mp3d_houses", household, path="folder")
def mp3d_houses(
    mining: Mining, folder: str, category: Category, rooms: HouseRooms, vocabulary: str
) -> Iterator[Observation]:
    """Observations of objects in rooms, from Matterport3D's houses.

    Args:
        mining: counts what is left after each step.
        folder: has the files ``*.house``, in it or in folders below.
        category: which of their two names objects go by.
        rooms: room of each label of a region; other regions are left out.
        vocabulary: path of the file that says which categories are left out, and which have another name.
    """
    return mine(read_houses(Path(folder), category), rooms, read_vocabulary(Path(vocabulary)), mining.counts)


def read_vocabulary(path: Path) -> Vocabulary:
    """The vocabulary in a YAML file; it is no setting itself, since DVC parses the params once a stage.

    Raises:
        InputError: where the file is missing or no YAML, or does not hold what a vocabulary does.
    """
    return config.check(config.read(path), Vocabulary, "", path)


def mine(
    batches: Iterable[Sequence[Tally]], rooms: Mapping[str, str], words: Vocabulary, counts: Counter[str]
) -> Iterator[Observation]:
    """Observations, with equal ones of a batch added up.

    Args:
        batches: of objects, for example those of one house; only one is held at once.
        rooms: of each type of region; other regions are left out.
        words: what is left out, too, and the names of what is not.
        counts: grows, as batches go by, by the instances that are left after each of ``STEPS``.
    """
    for batch in batches:
        placed = [tally for tally in batch if tally.region is not None and tally.category is not None]
        in_rooms = [tally for tally in placed if tally.region in rooms]
        objects = [tally for tally in in_rooms if tally.category not in words.structure]
        for step, left in zip(STEPS, (batch, placed, in_rooms, objects), strict=True):
            counts[step] += sum(tally.count for tally in left)
        observed: Counter[tuple[str | None, str, str | None, str]] = Counter()
        for tally in objects:
            region, category = str(tally.region), str(tally.category)
            observed[tally.scene, rooms[region], tally.instance, words.same_as.get(category, category)] += tally.count
        for (scene, room, instance, head), count in observed.items():
            yield scene, room, instance, head, AT_LOCATION, room, count


def category_name(category: str) -> str:
    """Lower-case words of a category: ``chest_of_drawers`` and ``Chest#of#drawers`` → ``chest of drawers``."""
    return " ".join(re.sub("[#_]", " ", category).lower().split())


def read_tallies(path: Path, regions: Collection[str]) -> list[Tally]:
    """Published counts of objects by region type, over all houses.

    Args:
        path: CSV of ``object,room,count``.
        regions: types that must be there.

    Raises:
        InputError: where the file is missing or broken, lists a pair twice, or lacks one of the regions.
    """
    table = read_table(path, ["object", "room", "count"])
    tallies: dict[tuple[str, str], Tally] = {}
    for line, category, region, count in table.itertuples(name=None):
        name = category_name(category)
        fault = name_fault(name) or f"{short(name)} in {short(region)} is listed twice" * ((name, region) in tallies)
        if fault:
            raise InputError(path, f"line {line}", fault)
        tallies[name, region] = Tally(None, None, region, name, count)
    unknown = set(regions) - set(table["room"])
    if unknown:
        raise InputError(path, f"room {short(min(unknown))}", "named in the setting rooms, but not here")
    return [*tallies.values()]


def read_houses(folder: Path, category: Category) -> Iterator[list[Tally]]:
    """The objects of each ``*.house`` file in a folder and the folders in it, in the order of their paths.

    Args:
        folder: where to look.
        category: which of their two names objects go by.

    Raises:
        InputError: where there is no such file, one is broken, or two are of the same house.
    """
    try:
        files = sorted(path for path in folder.rglob("*.house") if path.is_file())
    except OSError as error:
        raise InputError(folder, "", f"expected a folder with *.house files ({error.strerror})") from error
    if not files:
        raise InputError(folder, "", "expected a folder with *.house files, unpacked")
    path_of: dict[str, Path] = {}
    for path in files:
        house, tallies = read_house(path, CATEGORY_FIELD[category])
        if house in path_of:
            raise InputError(path, f"house {short(house)}", f"is also in {path_of[house]}")
        path_of[house] = path
        yield tallies


def read_house(path: Path, category_field: int) -> tuple[str, list[Tally]]:
    """The name of a house, and its objects.

    Raises:
        InputError: where the file is in another format, its header counts other records than it has, or an
            object names a region or a category that it lacks.
    """
    first, *lines = read_text(path, "a .house file").split("\n")
    version = re.fullmatch(r"ASCII\s+(\S+)\s*", first)
    if not version or version[1] not in HEADERS:
        raise InputError(path, "line 1", "expected a .house file, which starts with ASCII 1.0 or ASCII 1.1")
    line, house, expected, counts = 2, "", Counter[str](), Counter[str]()
    regions, categories, objects = dict[int, str](), dict[int, str](), dict[int, tuple[int, int, int]]()
    try:
        for line, fields in enumerate(map(str.split, lines), 2):
            kind = fields[0] if fields else ""
            counts[kind] += 1
            if not house and kind:
                if kind != "H":
                    raise ValueError("expected the header, a record H")
                house, header = check_name(fields[1].replace("#", " ")), line
                for place, letter in enumerate(HEADERS[version[1]], 3):
                    expected[letter] += _integer(fields[place])
            elif kind == "R":
                _add(regions, fields, fields[5])
            elif kind == "C":
                _add(categories, fields, category_name(fields[category_field]))
            elif kind == "O":
                _add(objects, fields, (line, _integer(fields[2]), _integer(fields[3])))
            elif kind and kind not in RECORD_KINDS:
                raise ValueError(f"expected a record of a kind {', '.join(RECORD_KINDS)}, got {short(kind)}")
    except (ValueError, IndexError) as error:
        problem = (
            f"{len(fields)} fields are too few for a record {kind}" if isinstance(error, IndexError) else str(error)
        )
        raise InputError(path, f"line {line}", problem) from error
    if not house:
        raise InputError(path, "line 2", "expected the header, a record H")
    for kind, number in expected.items():
        if counts[kind] != number:
            problem = f"the header counts {number} {RECORD_KINDS[kind]} ({kind}), the file has {counts[kind]}"
            raise InputError(path, f"line {header}", problem)
    tallies = []
    for number, (line, region, category) in objects.items():
        for what, place, names in (("region", region, regions), ("category", category, categories)):
            missing = f"object {number} is of {what} {place}, which the file lacks" * (
                place != -1 and place not in names
            )
            if fault := missing or (name_fault(names[place]) if place in names else None):
                raise InputError(path, f"line {line}", fault)
        tallies.append(Tally(house, str(number), regions.get(region), categories.get(category), 1))
    return house, tallies


def _add(by_number: dict[int, T], fields: Sequence[str], value: T) -> None:
    number = _integer(fields[1])
    if number in by_number:
        raise ValueError(f"{fields[0]} {number} is there already")
    by_number[number] = value


def _integer(text: str) -> int:
    if not re.fullmatch(r"-?[0-9]{1,9}", text):
        raise ValueError(f"expected a whole number of at most nine digits, got {short(text)}")
    return int(text)
