"""Observations of ProcTHOR's houses: rooms from positions,
affordances from recorded objects of the same type.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isi.config import Sha256, distinct, ensure
from isi.errors import InputError, short
from isi.random import stream
from isi.sources import Mining, Observation, observed, reader
from isi.sources.ai2thor import Materials, MaterialsOf, materials_of
from isi.sources.names import Name, entity_name, household
from isi.sources.readers import json_lines, packaged, parse_json, read_json
from isi.sources.recordings import AFFORDANCES, Scene, SceneObject, locate, read_recording

#: Maximum size of a house: bytes, objects, and corners of all its floors. In ProcTHOR-10K, no house
#: has more than a few hundred thousand bytes, a few hundred objects and a few dozen corners.
LONGEST, MOST_OBJECTS, MOST_CORNERS = 16 * 2**20, 10_000, 2_000
ROUNDED = 0.001  #: Precision of the corners of floors (metres); tolerance of borders.
SCHEMAS = ("0.0.1", "1.0.0")  #: Versions of the format.
INSTANCES = "instances"
OUTSIDE = "dropped, in no room of their house"
TAKEN = "dropped, with the id of another one in their house"
UNNAMED = "with an id that names no room of their house"
ELSEWHERE = "in another room than their id names"
#: The name of the type follows; such objects get no affordances, and materials only from SUNCG's
#: shares.
UNRECORDED = "of a type that was never recorded: "


class _Fields(BaseModel):
    """A JSON object; unknown keys are ignored."""

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class Point(_Fields):
    """A point on the floor, in metres."""

    x: float
    z: float


class Room(_Fields):
    """A room, with the corners of its floor in order."""

    id: Annotated[str, Field(pattern=r"^room\|[0-9]{1,9}$")]
    type: Annotated[str, Field(alias="roomType", pattern=r"^[A-Za-z][A-Za-z ]{0,59}$")]
    floor: Annotated[list[Point], Field(alias="floorPolygon", min_length=3)]


class Item(_Fields):
    """An object, with the objects on and in it (``children``)."""

    id: Name
    asset: Annotated[Name, Field(alias="assetId")]
    position: Point
    children: list[Item] | None = None


class House(_Fields):
    """A house in either version of ProcTHOR-10K's format; its objects form a forest."""

    rooms: Annotated[
        list[Room],
        Field(min_length=1),
        ensure(
            lambda rooms: sum(len(room.floor) for room in rooms) <= MOST_CORNERS,
            f"at most {MOST_CORNERS:,} corners",
        ),
        ensure(lambda rooms: distinct(room.id for room in rooms), "a different id for each room"),
    ]
    objects: list[Item] | None
    metadata: (
        Annotated[
            dict[str, Any], ensure(lambda data: data.get("schema") in SCHEMAS, "a known schema")
        ]
        | None
    ) = None


#: An object of a house, its position, and the id of the room that its id contains (None: no room).
HouseObject = tuple[SceneObject, Point, str | None]
RecordedTypes = Mapping[str, Sequence[SceneObject]]  #: Recorded objects by name of their type.


@reader(
    "procthor_houses",
    household,
    path="path",
    reads_json=lambda value: isinstance(value, dict) and {"rooms", "objects"} <= value.keys(),
    defaults={"sha256": None, "materials": "simulator"},
)
def procthor_houses(
    mining: Mining, path: str, sha256: Sha256 | None, materials: Materials
) -> Iterator[Observation]:
    """Observations of objects in houses; walls, doors,
    windows and floors are not among the objects.

    ``path`` is a file in ProcTHOR-10K's format, with one house per line (plain or gzip), or one
    house as ``*.json``. ``materials``: ``suncg`` samples by SUNCG's shares, ``simulator`` copies
    those of a random recorded object.
    """
    recorded, counts = recorded_types(read_recording(locate("recording"), None)), mining.counts
    affordances = {name: affordances_of(objects) for name, objects in recorded.items()}
    draw = (
        materials_of(materials, mining.seed)
        if materials == "suncg"
        else recorded_materials(recorded, mining.seed)
    )
    counts.update(dict.fromkeys((INSTANCES, OUTSIDE, TAKEN, UNNAMED, ELSEWHERE), 0))
    for number, house, objects in read_houses(Path(path), sha256):
        room_ids, ids = {room.id for room in house.rooms}, set[str]()
        placed: list[tuple[str, SceneObject]] = []
        for (thing, _, named), room in zip(objects, rooms_of(house.rooms, objects), strict=True):
            counts[INSTANCES] += 1
            if thing.id in ids:
                counts[TAKEN] += 1
            elif room is None:
                counts[OUTSIDE] += 1
            else:
                counts[UNNAMED] += named not in room_ids
                counts[ELSEWHERE] += named in room_ids - {room.id}
                placed.append((entity_name(room.type), thing))
            ids.add(thing.id)
        for (place, thing), made_of in zip(
            placed, draw(number, [thing for _, thing in placed]), strict=True
        ):
            if thing.name not in affordances:
                counts[UNRECORDED + thing.name] += 1
            seen = thing.receptacles, made_of, affordances.get(thing.name, ())
            yield from observed(f"House{number}", place, thing.id, thing.name, *seen)


def recorded_types(scenes: Iterable[Scene]) -> RecordedTypes:
    """Lists of the objects of all scenes, by the name of their type."""
    objects: dict[str, list[SceneObject]] = {}
    for thing in (thing for scene in scenes for thing in scene.objects):
        objects.setdefault(thing.name, []).append(thing)
    return objects


def affordances_of(objects: Sequence[SceneObject]) -> list[str]:
    """Affordances that more than half of the objects have, in the order of ``AFFORDANCES``."""
    counts = Counter(action for thing in objects for action in thing.affordances)
    return [
        action
        for actions in AFFORDANCES.values()
        for action in actions
        if 2 * counts[action] > len(objects)
    ]


def recorded_materials(recorded: RecordedTypes, root: int) -> MaterialsOf:
    """Copy the materials of a random recorded object of the same type (else none);
    one random stream per house.
    """

    def draw(house: int, objects: Sequence[SceneObject]) -> list[Sequence[str]]:
        draws = stream(root, "recorded materials", house).random(len(objects)).tolist()
        choices = [recorded.get(thing.name) or [thing] for thing in objects]
        return [
            among[int(draw * len(among))].materials
            for among, draw in zip(choices, draws, strict=True)
        ]

    return draw


def rooms_of(rooms: Sequence[Room], objects: Sequence[HouseObject]) -> list[Room | None]:
    """The room that contains each object, else borders it, else None;
    of several, the one in its id, else the first.
    """
    x, z = np.array([(point.x, point.z) for _, point, _ in objects]).reshape(-1, 2).T
    scores = np.zeros((len(rooms), len(objects)), dtype=int)
    for room, score in zip(rooms, scores, strict=True):
        inside, borders = np.zeros((2, len(objects)), dtype=bool)
        for start, end in zip([room.floor[-1], *room.floor], room.floor, strict=False):
            along, across = end.x - start.x, end.z - start.z
            with np.errstate(over="ignore", invalid="ignore"):
                if across:
                    crosses = (start.z > z) != (end.z > z)
                    inside ^= crosses & (x < start.x + (z - start.z) / across * along)
                length = along * along + across * across
                share = ((x - start.x) * along + (z - start.z) * across) / length if length else 0.0
                share = np.clip(share, 0.0, 1.0)
                borders |= (
                    np.hypot(x - start.x - share * along, z - start.z - share * across) <= ROUNDED
                )
        is_named = np.array([named == room.id for *_, named in objects], dtype=bool)
        score[:] = np.where(inside, 4, 2 * borders) + ((inside | borders) & is_named)
    best = scores.argmax(0) if objects else []
    return [rooms[room] if scores[room, place] else None for place, room in enumerate(best)]


def read_houses(path: Path, sha256: str | None) -> Iterator[tuple[int, House, list[HouseObject]]]:
    """Yield (line, house, its objects) from a file;
    InputError for too many objects, or one of unknown type.
    """
    types, line = asset_types(), 0
    for line, content in json_lines(path, sha256, LONGEST, "a house as JSON"):
        house = parse_json(House, content, path, f"line {line}")
        objects = list(house_objects(house.objects or (), types))
        if len(objects) > MOST_OBJECTS:
            raise InputError(path, f"line {line}, objects", f"expected at most {MOST_OBJECTS:,}")
        if unknown := next((thing.id for thing, *_ in objects if not thing.name), None):
            expected = "expected an id that names its type, such as 'Bed|2|0', or a known asset"
            raise InputError(path, f"line {line}, object {short(unknown)}", expected)
        yield line, house, objects
    if not line:
        raise InputError(path, "", "expected houses, got none")


def house_objects(
    items: Iterable[Item], types: Mapping[str, str], parent: Sequence[str] = ()
) -> Iterator[HouseObject]:
    """Yield each object, then its children. Its type is that in its id,
    else ``types[asset]``, else empty.
    """
    for item in items:
        kind, room = type_and_room(item.id)
        name = entity_name(kind or types.get(item.asset, ""))
        yield SceneObject(item.id, name, parent), item.position, room
        yield from house_objects(item.children or (), types, [name])


@lru_cache(maxsize=2**16)
def type_and_room(identifier: str) -> tuple[str | None, str | None]:
    """Type and room id in an object's id, or None: ``Bed|2|0`` → ``Bed``, ``room|2``;
    ``2|0`` → None, ``room|2``.
    """
    first, *rest = identifier.split("|")
    kind = (
        first
        if first.isascii() and first.isalnum() and not first[0].isdigit() and first != "small"
        else None
    )
    number = next((text for text in (first, *rest) if text.isascii() and text.isdigit()), None)
    return kind, number and f"room|{number}"


def asset_types() -> dict[str, str]:
    """Type by asset, from the package ``procthor``."""
    content = "the assets of houses"
    path = packaged("procthor", "procthor/databases/asset-database.json", content)
    listed = read_json(dict[str, list[dict[str, Any]]], path, content)
    return {asset["assetId"]: kind for kind, assets in listed.items() for asset in assets}
