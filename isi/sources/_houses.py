"""Houses in the format of ProcTHOR-10K: rooms with the polygons of their floors, and objects at positions."""

from __future__ import annotations

import codecs
import gzip
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import hypot
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from isi.errors import InputError, cut, short
from isi.sources._files import check_sha256, packaged

#: The largest house that is read, in bytes, objects, and corners of floors; those of ProcTHOR-10K have a few hundred
#: thousand, hundred and dozen at most.
LONGEST = 16 * 2**20
MOST_OBJECTS, MOST_CORNERS = 10_000, 2_000
#: Corners of floors are rounded to it (metres).
ROUNDED = 0.001


class _Read(BaseModel):
    """What is read of a JSON object; its other keys are skipped."""

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class Point(_Read):
    """On the floor, in metres."""

    x: float
    z: float


class Room(_Read):
    """A room, with the corners of its floor in order."""

    id: Annotated[str, Field(pattern=r"^room\|[0-9]{1,9}$")]
    type: Annotated[str, Field(alias="roomType", pattern=r"^[A-Za-z][A-Za-z ]{0,59}$")]
    floor: Annotated[list[Point], Field(alias="floorPolygon", min_length=3)]

    def holds(self, point: Point) -> bool:
        """Whether a point lies in the room; one on the border of two lies in one of them alone."""
        inside, before = False, self.floor[-1]
        for corner in self.floor:
            if (before.z > point.z) != (corner.z > point.z):
                share = (point.z - before.z) / (corner.z - before.z)
                inside ^= point.x < before.x + share * (corner.x - before.x)
            before = corner
        return inside

    def borders(self, point: Point) -> bool:
        """Whether a point lies on the border of the room, as far as its corners are rounded."""
        return any(
            _distance(point, before, corner) <= ROUNDED
            for before, corner in zip([self.floor[-1], *self.floor], self.floor, strict=False)
        )


class Item(_Read):
    """An object, with those on or in it."""

    id: Annotated[str, Field(max_length=200, pattern=r"^\P{C}+$")]
    asset: Annotated[str, Field(alias="assetId", max_length=200, pattern=r"^\P{C}+$")]
    position: Point
    children: list[Item] | None = None


class Metadata(_Read):
    """What a house says of itself."""

    version: Literal["0.0.1", "1.0.0"] = Field(alias="schema")


class House(_Read):
    """A house, with its objects as a forest."""

    rooms: Annotated[list[Room], Field(min_length=1)]
    objects: list[Item] | None
    metadata: Metadata | None = None


class Asset(_Read):
    """What ProcTHOR knows of an asset."""

    name: Annotated[str, Field(alias="assetId")]


_ASSETS = TypeAdapter(dict[str, list[Asset]])


@dataclass(frozen=True)
class Placed:
    """An object of a house, out of the forest."""

    id: str
    #: such as ``AlarmClock``
    type: str
    position: Point
    #: type of what it is on or in
    parent: str | None
    #: id of the room that its own id names, if it names one
    room: str | None


def houses(path: Path, sha256: str | None) -> Iterator[tuple[int, House]]:
    """The houses of a file, and the line of each: JSON Lines, or one house where it is ``*.json``; plain or gzip.

    Args:
        path: of the file.
        sha256: what the file must hash to, if it is to be checked.

    Raises:
        InputError: where the file is missing, empty, truncated, or hashes to something else; or where a line is no
            house, or two of its rooms have the same id.
    """
    last = 0
    for last, content in _lines(path, sha256):
        try:
            house = House.model_validate_json(content)
        except ValidationError as error:
            raise _refused(path, last, error) from error
        ids = [room.id for room in house.rooms]
        if len(set(ids)) < len(ids):
            raise InputError(path, f"line {last}", "two rooms have the same id")
        if sum(len(room.floor) for room in house.rooms) > MOST_CORNERS:
            raise InputError(path, f"line {last}", f"expected at most {MOST_CORNERS:,} corners of floors")
        yield last, house
    if not last:
        raise InputError(path, "", "expected houses, found none")


def objects(house: House, types: Mapping[str, str]) -> Iterator[Placed]:
    """The objects of a house, each before those on or in it.

    Args:
        house: as read.
        types: of each asset, for objects whose ids do not say theirs (``small|2|0``).

    Raises:
        InputError: where the type of one is not known; the file and its line are not named.
    """
    waiting: list[tuple[Item, str | None]] = [(item, None) for item in reversed(house.objects or ())]
    number = 0
    while waiting:
        item, parent = waiting.pop()
        if (number := number + 1) > MOST_OBJECTS:
            raise InputError("objects", "", f"expected at most {MOST_OBJECTS:,}")
        named, room = named_by(item.id)
        kind = named or types.get(item.asset)
        if kind is None:
            whose = f"object {short(item.id)}"
            raise InputError(whose, "", f"expected an id such as 'Bed|2|0', or a known asset, got {short(item.asset)}")
        yield Placed(item.id, kind, item.position, parent, room)
        waiting.extend((child, kind) for child in reversed(item.children or ()))


@lru_cache(maxsize=2**16)
def named_by(identifier: str) -> tuple[str | None, str | None]:
    """Type and id of the room that an object's id names: ``Bed|2|0``, ``Book|surface|2|0``, ``small|2|0``, ``2|0``."""
    first, *rest = identifier.split("|")
    kind = first if first.isascii() and first.isalnum() and not first[0].isdigit() and first != "small" else None
    number = next((text for text in (first, *rest) if text.isascii() and text.isdigit()), None)
    return kind, number and f"room|{number}"


def asset_types() -> dict[str, str]:
    """The type of each asset of ProcTHOR's, from the data of the package ``procthor`` (which is never imported).

    Raises:
        InputError: where the package is not installed, or lacks its data.
    """
    path = packaged("procthor", "procthor/databases/asset-database.json", "the assets of houses")
    try:
        listed = _ASSETS.validate_json(path.read_bytes())
    except (OSError, ValueError) as error:
        problem = f"expected the assets of each type ({cut(str(error), 120)})"
        raise InputError("package procthor", "asset-database.json", problem) from error
    return {asset.name: kind for kind, assets in listed.items() for asset in assets}


def _lines(path: Path, sha256: str | None) -> Iterator[tuple[int, bytes]]:
    """What is not blank of a file, with its number, from 1."""
    whole, number = ".json" in path.suffixes[-2:], 0
    try:
        with path.open("rb") as raw:
            check_sha256(path, raw, sha256)
            file = gzip.GzipFile(fileobj=raw) if raw.peek(2)[:2] == b"\x1f\x8b" else raw
            while line := file.read(LONGEST + 1) if whole else file.readline(LONGEST + 1):
                number += 1
                if len(line) > LONGEST:
                    raise InputError(path, f"line {number}", f"longer than {LONGEST:,} bytes")
                if number == 1:
                    line = line.removeprefix(codecs.BOM_UTF8)
                if line.strip():
                    yield number, line
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"line {number + 1}", f"expected a house as JSON ({error})") from error


def _refused(path: Path, line: int, error: ValidationError) -> InputError:
    first = error.errors(include_url=False)[0]
    where = ", ".join([f"line {line}", *[cut(".".join(map(str, first["loc"])))] * bool(first["loc"])])
    got = "" if first["type"] in ("missing", "json_invalid") else f", got {short(first['input'])}"
    what = first["msg"].replace(" at line 1 column", ", column")
    return InputError(path, where, f"expected a house: {what}{got}")


def _distance(point: Point, start: Point, end: Point) -> float:
    """From a point to a segment."""
    along, across = end.x - start.x, end.z - start.z
    length = along * along + across * across
    share = ((point.x - start.x) * along + (point.z - start.z) * across) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return hypot(point.x - start.x - share * along, point.z - start.z - share * across)
