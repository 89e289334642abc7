"""Matterport3D's objects by room, from its own houses (``*.house``)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pyarrow as pa
from pydantic import Field

from isi.errors import InputError, short
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._mp3d import Counted, entity_name, mine, read_vocabulary
from isi.sources._naming import fault
from isi.sources._rows import read_text

#: Where a record ``C`` has the name of its category.
CATEGORY_FIELD = {"category_mapping_name": 3, "mpcat40": 5}
#: Kinds of records as their header counts them, in its order; panoramas and portals are both ``P``.
HEADERS = {"1.0": "IPVSRL", "1.1": "IPVSEOCRPL"}
RECORD_KINDS = {
    "I": "images", "P": "panoramas and portals", "V": "vertices", "S": "surfaces", "E": "segments", "O": "objects",
    "C": "categories", "R": "regions", "L": "levels",
}  # fmt: skip
#: Of a region.
Label = Annotated[str, Field(pattern=r"^[a-pr-zBCDSZ]$")]


@source("mp3d_houses", entities=household)
def mp3d_houses(
    mining: Mining,
    folder: str,
    category: Literal["category_mapping_name", "mpcat40"],
    rooms: Annotated[dict[Label, str], Field(min_length=1)],
    vocabulary: str,
) -> Iterator[pa.Table]:
    """Observations of objects in rooms.

    Args:
        mining: counts what is left after each step.
        folder: has the files, in it or in folders below.
        category: which of their two names objects go by.
        rooms: room of each label of a region; other regions are left out.
        vocabulary: path of the file that says which categories are left out, and which have another name.
    """
    words = read_vocabulary(Path(vocabulary))
    return mine(houses(Path(folder), category), rooms, words, mining.left)


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
        if not re.fullmatch(r"-?[0-9]{1,9}", text):
            of = f"field {place + 1} of a record {self.fields[0]}"
            raise self.error(f"expected a whole number of at most nine digits as {of}, got {short(text)}")
        return int(text)

    def error(self, expected: str) -> InputError:
        return InputError(self.path, f"line {self.line}", expected)


def houses(folder: Path, category: Literal["category_mapping_name", "mpcat40"]) -> Iterator[list[Counted]]:
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
    known: dict[str, Path] = {}
    for path in files:
        name, seen = read_house(path, CATEGORY_FIELD[category])
        if name in known:
            raise InputError(path, f"house {short(name)}", f"is also in {known[name]}")
        known[name] = path
        yield seen


def read_house(path: Path, category_field: int) -> tuple[str, list[Counted]]:
    """The name of a house, and its objects.

    Raises:
        InputError: where the file is in another format, its header counts other records than it has, or an
            object names a region or a category that it lacks.
    """
    lines = read_text(path, "a .house file").split("\n")
    version = _version(path, lines[0])
    kept: dict[str, list[Record]] = {"R": [], "C": [], "O": []}
    found: Counter[str] = Counter()
    records = (Record(path, number, line.split()) for number, line in enumerate(lines[1:], 2) if line.strip())
    header = next(records, None)
    if header is None or header.fields[0] != "H":
        raise InputError(path, f"line {header.line if header else 2}", "expected the header, a record H")
    for record in records:
        kind = record.fields[0]
        if kind not in RECORD_KINDS:
            raise record.error(f"expected a record of a kind {', '.join(RECORD_KINDS)}, got {short(kind)}")
        found[kind] += 1
        if kind in kept:
            kept[kind].append(record)
    _check_counts(header, HEADERS[version], found)
    regions = _numbered(kept["R"], 5)
    categories = {number: entity_name(name) for number, name in _numbered(kept["C"], category_field).items()}
    house = header.text(1).replace("#", " ")
    if wrong := fault(house):
        raise header.error(wrong)
    return house, [
        Counted(house, str(number), _named(record, 2, "region", regions), _named(record, 3, "category", categories), 1)
        for number, record in _unique(kept["O"]).items()
    ]


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
            raise header.error(f"the header counts {count} {RECORD_KINDS[kind]} ({kind}), the file has {found[kind]}")


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
    if wrong := fault(names[number]):
        raise thing.error(f"its {what}: {wrong}")
    return names[number]
