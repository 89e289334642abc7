"""Matterport3D's objects by room, from published tallies or from its own houses (section 6.3)."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa

from isi import paths
from isi.errors import InputError
from isi.tables import AT_LOCATION, OBSERVATIONS

COLUMNS = ("object", "room", "count")
#: Where a record ``C`` has the name of its category.
CATEGORY_FIELD = {"category_mapping_name": 3, "mpcat40": 5}
#: Kinds of records as their header counts them, in its order; panoramas and portals are both ``P``.
HEADERS = {"1.0": "IPVSRL", "1.1": "IPVSEOCRPL"}
KINDS = {
    "I": "images", "P": "panoramas and portals", "V": "vertices", "S": "surfaces", "E": "segments", "O": "objects",
    "C": "categories", "R": "regions", "L": "levels",
}  # fmt: skip
#: What is left after each step of mining.
STEPS = ("instances", "of a category and in a region", "in AI2-THOR's rooms", "without structure")


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
    """What AI2-THOR calls things; regions that are none of its rooms are left out, and so is structure."""

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
    rows = [
        (scene, room, instance, head, AT_LOCATION, room, count)
        for (scene, room, instance, head), count in counts.items()
    ]
    columns = zip(*rows, strict=True) if rows else [()] * len(OBSERVATIONS)
    arrays = [pa.array(column, field.type) for column, field in zip(columns, OBSERVATIONS, strict=True)]
    return pa.Table.from_arrays(arrays, schema=OBSERVATIONS)


def entity_name(category: str) -> str:
    """Lower-case words of a category: ``chest_of_drawers`` and ``Chest#of#drawers`` → ``chest of drawers``."""
    return " ".join(re.sub("[#_]", " ", category).lower().split())


# Tallies


def tallies(path: Path, regions: Collection[str]) -> list[Seen]:
    """Published counts of objects by region type, over all houses.

    Args:
        path: CSV of ``object,room,count``.
        regions: types that must be there.

    Raises:
        InputError: where the file is missing or broken, lists a pair twice, or lacks one of the regions.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file, restval="")
            missing = set(COLUMNS) - set(reader.fieldnames or ())
            if missing:
                raise InputError(path, f"column {min(missing)!r}", "missing")
            seen = [_tally(path, reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, "", f"expected a CSV file ({error})") from error
    twice = [pair for pair, times in Counter((one.category, one.region) for one in seen).items() if times > 1]
    if twice:
        raise InputError(path, "", f"{twice[0][0]!r} in {twice[0][1]!r} is listed twice")
    unknown = set(regions) - {one.region for one in seen}
    if unknown:
        raise InputError(paths.PARAMS, "mp3d.rooms.tallies", f"{min(unknown)!r} is no room of {path}")
    return seen


def _tally(path: Path, line: int, row: dict[str, str]) -> Seen:
    category, region, count = (row[column] for column in COLUMNS)
    if not category or not region or not re.fullmatch(r"[0-9]+", count):
        raise InputError(path, f"line {line}", "expected an object, a room and a count")
    return Seen(None, None, region, entity_name(category), int(count))


# Houses


@dataclass(frozen=True)
class Record:
    """A line of a ``.house`` file."""

    path: Path
    line: int
    fields: list[str]

    def text(self, place: int) -> str:
        if place >= len(self.fields):
            raise self.error(f"expected more than {len(self.fields)} fields in a record {self.fields[0]}")
        return self.fields[place]

    def integer(self, place: int) -> int:
        text = self.text(place)
        if not re.fullmatch(r"-?[0-9]+", text):
            raise self.error(f"expected an integer as field {place + 1} of a record {self.fields[0]}, got {text!r}")
        return int(text)

    def error(self, expected: str) -> InputError:
        return InputError(self.path, f"line {self.line}", expected)


def houses(folder: Path, category: Literal["category_mapping_name", "mpcat40"]) -> Iterator[list[Seen]]:
    """The objects of each ``*.house`` file in a folder and the folders in it, in the order of their paths.

    Args:
        folder: where to look.
        category: which of their two names objects go by.

    Raises:
        InputError: where there is no such file, one is broken, or two are of the same house.
    """
    files = sorted(path for path in folder.rglob("*.house") if path.is_file())
    if not files:
        raise InputError(folder, "", "expected a folder with *.house files, unpacked (params.yaml: mp3d.houses)")
    known: dict[str, Path] = {}
    for path in files:
        name, seen = read_house(path, CATEGORY_FIELD[category])
        if name in known:
            raise InputError(path, f"house {name!r}", f"is also in {known[name]}")
        known[name] = path
        yield seen


def read_house(path: Path, category_field: int) -> tuple[str, list[Seen]]:
    """The name of a house, and its objects.

    Raises:
        InputError: where the file is in another format, its header counts other records than it has, or an
            object names a region or a category that it lacks.
    """
    lines = _lines(path)
    version = _version(path, lines[0])
    kept: dict[str, list[Record]] = {"R": [], "C": [], "O": []}
    found: Counter[str] = Counter()
    records = (Record(path, number, line.split()) for number, line in enumerate(lines[1:], 2) if line.strip())
    header = next(records, None)
    if header is None or header.fields[0] != "H":
        raise InputError(path, f"line {header.line if header else 2}", "expected the header, a record H")
    for record in records:
        kind = record.fields[0]
        if kind not in KINDS:
            raise record.error(f"expected a record of a kind {', '.join(KINDS)}, got {kind!r}")
        found[kind] += 1
        if kind in kept:
            kept[kind].append(record)
    _check_counts(header, HEADERS[version], found)
    regions = _numbered(kept["R"], 5)
    categories = {number: entity_name(name) for number, name in _numbered(kept["C"], category_field).items()}
    house = header.text(1).replace("#", " ")
    return house, [
        Seen(house, str(number), _named(record, 2, "region", regions), _named(record, 3, "category", categories), 1)
        for number, record in _unique(kept["O"]).items()
    ]


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "", f"expected a .house file ({error})") from error


def _version(path: Path, line: str) -> str:
    found = re.fullmatch(r"ASCII\s+(\S+)\s*", line)
    if not found or found[1] not in HEADERS:
        raise InputError(path, "line 1", "expected a .house file, which starts with ASCII 1.0 or ASCII 1.1")
    return found[1]


def _check_counts(header: Record, kinds: str, found: Counter[str]) -> None:
    expected: Counter[str] = Counter()
    for place, kind in enumerate(kinds, 3):
        expected[kind] += header.integer(place)
    for kind, count in expected.items():
        if found[kind] != count:
            raise header.error(f"the header counts {count} {KINDS[kind]} ({kind}), the file has {found[kind]}")


def _numbered(records: Sequence[Record], field: int) -> dict[int, str]:
    """One field of each record, by its number."""
    return {number: record.text(field) for number, record in _unique(records).items()}


def _unique(records: Sequence[Record]) -> dict[int, Record]:
    by_number: dict[int, Record] = {}
    for record in records:
        number = record.integer(1)
        if number in by_number:
            raise record.error(f"{record.fields[0]} {number} is also in line {by_number[number].line}")
        by_number[number] = record
    return by_number


def _named(thing: Record, field: int, what: str, names: Mapping[int, str]) -> str | None:
    """The name of what an object refers to by number; none for -1."""
    number = thing.integer(field)
    if number == -1:
        return None
    if number not in names:
        raise thing.error(f"object {thing.integer(1)} is of {what} {number}, which the file lacks")
    return names[number]
