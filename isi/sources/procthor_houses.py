"""ProcTHOR's houses, mined into observations: rooms by position, the rest by what was recorded of the same types."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from math import hypot
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from isi.config import Sha256
from isi.errors import InputError, short
from isi.random import stream
from isi.sources import Mining, Observation, observed, reader
from isi.sources.materials import Materials, MaterialsOf, materials_of, reported_materials
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, entity_name, household
from isi.sources.readers import json_lines, packaged, parse_json, read_text
from isi.sources.recordings import AFFORDANCES, Scene, SceneObject, locate, read_recording

#: The largest house that is read, in bytes, objects, and corners of floors; those of ProcTHOR-10K have a few hundred
#: thousand, hundred and dozen at most.
LONGEST = 16 * 2**20
MOST_OBJECTS, MOST_CORNERS = 10_000, 2_000
#: Corners of floors are rounded to it (metres).
ROUNDED = 0.001
INSTANCES = "instances"
OUTSIDE = "dropped, in no room of their house"
TAKEN = "dropped, with the id of another one in their house"
UNNAMED = "with an id that names no room of their house"
ELSEWHERE = "in another room than their id names"
#: Followed by the name of the type: these have no affordances, and no materials but SUNCG's.
UNRECORDED = "of a type that was never recorded: "


class _Fields(BaseModel):
    """What is read of a JSON object; its other keys are skipped."""

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class Point(_Fields):
    """On the floor, in metres."""

    x: float
    z: float


class Room(_Fields):
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
        sides = zip([self.floor[-1], *self.floor], self.floor, strict=False)
        return any(_distance(point, before, corner) <= ROUNDED for before, corner in sides)


def _distance(point: Point, start: Point, end: Point) -> float:
    """From a point to a segment."""
    along, across = end.x - start.x, end.z - start.z
    length = along * along + across * across
    share = ((point.x - start.x) * along + (point.z - start.z) * across) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return hypot(point.x - start.x - share * along, point.z - start.z - share * across)


_Text = Annotated[str, Field(max_length=200, pattern=r"^\P{C}+$")]


class Item(_Fields):
    """An object, with those on or in it."""

    id: _Text
    asset: Annotated[_Text, Field(alias="assetId")]
    position: Point
    children: list[Item] | None = None


class Metadata(_Fields):
    """The version of a house's format."""

    version: Literal["0.0.1", "1.0.0"] = Field(alias="schema")


class House(_Fields):
    """A house in the format of ProcTHOR-10K, with its objects as a forest."""

    rooms: Annotated[list[Room], Field(min_length=1)]
    objects: list[Item] | None
    metadata: Metadata | None = None


class HouseObject(NamedTuple):
    """An object of a house, out of the forest."""

    id: str
    #: such as ``AlarmClock``
    type: str
    position: Point
    #: type of what it is on or in
    parent: str | None
    #: id of the room that its own id names, if it names one
    room: str | None


class RecordedTypes(NamedTuple):
    """What was recorded of the objects of each type, by its name (``entity_name``)."""

    #: what can be done with more than half of them
    affordances: Mapping[str, Sequence[str]]
    #: of each of them
    materials: Mapping[str, Sequence[list[str]]]


@reader(
    "procthor_houses",
    household,
    path="path",
    reads_json=lambda value: isinstance(value, dict) and "rooms" in value and "kitchens" not in value,
    defaults={"sha256": None, "materials": "simulator"},
)
def procthor_houses(mining: Mining, path: str, sha256: Sha256 | None, materials: Materials) -> Iterator[Observation]:
    """Observations of objects in houses. Walls, doors, windows and floors are no objects there.

    Args:
        mining: its seed draws materials; counts what is left out, and what is odd.
        path: of a file in the format of ProcTHOR-10K, a house a line, plain or gzip; or of one house, ``*.json``.
        sha256: what the file must hash to, if it is to be checked.
        materials: drawn as in SUNCG, or those of a recorded object of the same type, drawn at random.
    """
    types = recorded_types(read_recording(locate("recording"), None))
    by_type = recorded_materials(types.materials, mining.seed)
    drawn = by_type if materials == "simulator" else materials_of(materials, mining.seed)
    mining.counts.update(dict.fromkeys((INSTANCES, OUTSIDE, TAKEN, UNNAMED, ELSEWHERE), 0))
    return mine(read_houses(Path(path), sha256), types.affordances, drawn, mining.counts)


def recorded_types(scenes: Iterable[Scene]) -> RecordedTypes:
    """What the objects of scenes are, by type; the properties of a type hardly differ from one to the other."""
    objects: dict[str, list[SceneObject]] = {}
    for scene in scenes:
        for thing in scene.objects:
            objects.setdefault(entity_name(thing["objectType"]), []).append(thing)
    affordances = {
        name: [
            action
            for key, actions in AFFORDANCES.items()
            if 2 * sum(bool(thing.get(key)) for thing in of_type) > len(of_type)
            for action in actions
        ]
        for name, of_type in objects.items()
    }
    return RecordedTypes(affordances, {name: reported_materials(0, of_type) for name, of_type in objects.items()})


def recorded_materials(materials: Mapping[str, Sequence[list[str]]], root: int) -> MaterialsOf:
    """Draw a recorded object of the same type, and take its materials; none where none was recorded.

    There is one stream per house: a house's draws depend on its number and its objects alone.
    """

    def draw(house: int, objects: Sequence[SceneObject]) -> list[list[str]]:
        draws = stream(root, "recorded materials", house).random(len(objects)).tolist()
        choices = [materials.get(entity_name(thing["objectType"])) or [[]] for thing in objects]
        return [among[int(draw * len(among))] for among, draw in zip(choices, draws, strict=True)]

    return draw


def mine(
    houses: Iterable[tuple[int, House, list[HouseObject]]],
    affordances: Mapping[str, Sequence[str]],
    drawn: MaterialsOf,
    counts: Counter[str],
) -> Iterator[Observation]:
    """Observations of houses, in their order; only one is held at once.

    Args:
        houses: by line, with their objects.
        affordances: of each name of a type that was recorded.
        drawn: materials of each object of a house, in the order of the objects.
        counts: grows by what is left out, and by what is odd.
    """
    for number, house, objects in houses:
        placed = in_rooms(house, objects, counts)
        all_materials = drawn(number, [{"objectType": thing.type} for thing, _ in placed])
        for (thing, room), materials in zip(placed, all_materials, strict=True):
            head = entity_name(thing.type)
            if head not in affordances:
                counts[UNRECORDED + head] += 1
            locations = [room, entity_name(thing.parent)] if thing.parent else [room]
            actions = affordances.get(head, ())
            tails = (AT_LOCATION, locations), (HAS_MATERIAL, materials), (HAS_AFFORDANCE, actions)
            yield from observed(f"House{number}", room, thing.id, head, tails)


def in_rooms(house: House, objects: Iterable[HouseObject], counts: Counter[str]) -> list[tuple[HouseObject, str]]:
    """Objects with the name of the room whose floor they are on or above; those in no room are left out."""
    ids: set[str] = set()
    rooms = {room.id: room for room in house.rooms}
    placed = []
    for thing in objects:
        counts[INSTANCES] += 1
        room = _room_of(thing, rooms)
        if thing.id in ids:
            counts[TAKEN] += 1
        elif room is None:
            counts[OUTSIDE] += 1
        else:
            counts[UNNAMED] += thing.room not in rooms
            counts[ELSEWHERE] += thing.room in rooms and thing.room != room.id
            placed.append((thing, entity_name(room.type)))
        ids.add(thing.id)
    return placed


def _room_of(thing: HouseObject, rooms: Mapping[str, Room]) -> Room | None:
    """The room that holds an object, or else that it borders; of several, the one that its id names, or the first."""
    named = rooms.get(thing.room or "")
    order = [named, *rooms.values()] if named else list(rooms.values())
    holding = next((room for room in order if room.holds(thing.position)), None)
    return holding or next((room for room in order if room.borders(thing.position)), None)


def read_houses(path: Path, sha256: str | None) -> Iterator[tuple[int, House, list[HouseObject]]]:
    """The houses of a file by their lines, with their objects: JSON Lines, or one house where it is ``*.json``.

    Args:
        path: of the file, plain or gzip.
        sha256: what the file must hash to, if it is to be checked.

    Raises:
        InputError: where the file is missing, empty, truncated, or hashes to something else; or where a line is no
            house, two of its rooms have the same id, or the type of an object is not known.
    """
    types, line = asset_types(), 0
    for line, content in json_lines(path, sha256, LONGEST, "a house as JSON", whole=".json" in path.suffixes[-2:]):
        house = parse_json(House, content, path, f"line {line}", "a house")
        if len({room.id for room in house.rooms}) < len(house.rooms):
            raise InputError(path, f"line {line}", "two rooms have the same id")
        if sum(len(room.floor) for room in house.rooms) > MOST_CORNERS:
            raise InputError(path, f"line {line}", f"expected at most {MOST_CORNERS:,} corners of floors")
        objects = list(islice(house_objects(house, types), MOST_OBJECTS + 1))
        if len(objects) > MOST_OBJECTS:
            raise InputError(path, f"line {line}, objects", f"expected at most {MOST_OBJECTS:,}")
        if unknown := next((thing.id for thing in objects if not thing.type), None):
            expected = "expected an id that names its type, such as 'Bed|2|0', or a known asset"
            raise InputError(path, f"line {line}, object {short(unknown)}", expected)
        yield line, house, objects
    if not line:
        raise InputError(path, "", "expected houses, found none")


def house_objects(house: House, types: Mapping[str, str]) -> Iterator[HouseObject]:
    """The objects of a house, each before those on or in it.

    Args:
        house: as read.
        types: of each asset, for objects whose ids do not say theirs (``small|2|0``); empty where neither says it.
    """
    waiting: list[tuple[Item, str | None]] = [(item, None) for item in reversed(house.objects or ())]
    while waiting:
        item, parent = waiting.pop()
        named, room = type_and_room(item.id)
        kind = named or types.get(item.asset, "")
        yield HouseObject(item.id, kind, item.position, parent, room)
        waiting.extend((child, kind) for child in reversed(item.children or ()))


@lru_cache(maxsize=2**16)
def type_and_room(identifier: str) -> tuple[str | None, str | None]:
    """Type and id of the room that an object's id names: ``Bed|2|0``, ``Book|surface|2|0``, ``small|2|0``, ``2|0``."""
    first, *rest = identifier.split("|")
    kind = first if first.isascii() and first.isalnum() and not first[0].isdigit() and first != "small" else None
    number = next((text for text in (first, *rest) if text.isascii() and text.isdigit()), None)
    return kind, number and f"room|{number}"


class _Asset(BaseModel):
    name: Annotated[str, Field(alias="assetId")]


def asset_types() -> dict[str, str]:
    """The type of each asset of ProcTHOR's, from the data of the package ``procthor`` (which is never imported).

    Raises:
        InputError: where the package is not installed, or lacks its data.
    """
    content = "the assets of houses"
    path = packaged("procthor", "procthor/databases/asset-database.json", content)
    listed = parse_json(dict[str, list[_Asset]], read_text(path, content), path, expected=content)
    return {asset.name: kind for kind, assets in listed.items() for asset in assets}
