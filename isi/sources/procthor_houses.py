"""ProcTHOR's houses, mined into observations: rooms by position, the rest by what was recorded of the same types."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path

import pyarrow as pa

from isi.config import Sha256
from isi.errors import InputError
from isi.random import stream
from isi.sources import Mining, part, source
from isi.sources._household import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, entity_name, household
from isi.sources._houses import House, Placed, Room, asset_types, houses, objects
from isi.sources._materials import MaterialsOf, Object, simulator
from isi.sources._mining import Materials, materials_of
from isi.sources._recording import AFFORDANCES, Scene, locate, read_recording

#: Houses mined as one: a row group of the table.
CHUNK = 120

INSTANCES = "instances"
OUTSIDE = "dropped, in no room of their house"
TAKEN = "dropped, with the id of another one in their house"
UNNAMED = "with an id that names no room of their house"
ELSEWHERE = "in another room than their id names"
#: Followed by the name of the type: these have no affordances, and no materials but SUNCG's.
UNRECORDED = "of a type that was never recorded: "


@dataclass(frozen=True)
class Recorded:
    """What was recorded of the objects of a type, by its name (``entity_name``)."""

    #: what can be done with more than half of them
    affordances: Mapping[str, Sequence[str]]
    #: of each of them
    materials: Mapping[str, Sequence[list[str]]]


@source("procthor_houses", entities=household)
def procthor_houses(mining: Mining, path: str, sha256: Sha256 | None, materials: Materials) -> Iterator[pa.Table]:
    """Observations of objects in houses. Walls, doors, windows and floors are no objects there.

    Args:
        mining: its seed draws materials; counts what is left out, and what is odd.
        path: of a file in the format of ProcTHOR-10K, a house a line, plain or gzip; or of one house, ``*.json``.
        sha256: what the file must hash to, if it is to be checked.
        materials: drawn as in SUNCG, or those of a recorded object of the same type, drawn at random.
    """
    known = recorded(read_recording(locate("recording"), None))
    by_type = by_recorded(known.materials, mining.seed)
    drawn = by_type if materials == "simulator" else materials_of(materials, mining.seed)
    mining.left.update(dict.fromkeys((INSTANCES, OUTSIDE, TAKEN, UNNAMED, ELSEWHERE), 0))
    return mine(numbered(Path(path), sha256), known.affordances, drawn, mining.left)


def recorded(scenes: Iterable[Scene]) -> Recorded:
    """What the objects of scenes are, by type; the properties of a type hardly differ from one to the other."""
    things: dict[str, list[Object]] = {}
    for scene in scenes:
        for thing in scene.objects:
            things.setdefault(entity_name(thing["objectType"]), []).append(thing)
    return Recorded(
        {name: _affordances(same) for name, same in things.items()},
        {name: simulator(0, same) for name, same in things.items()},
    )


def _affordances(same: Sequence[Object]) -> list[str]:
    of_most = (pair for key, pair in AFFORDANCES.items() if 2 * sum(bool(thing.get(key)) for thing in same) > len(same))
    return [affordance for pair in of_most for affordance in pair]


def by_recorded(materials: Mapping[str, Sequence[list[str]]], root: int) -> MaterialsOf:
    """Draw a recorded object of the same type, and take its materials; none where none was recorded.

    One stream per house, so that a house's draws depend on nothing but its number and its objects.
    """
    return partial(_drawn, materials, root)


def _drawn(
    materials: Mapping[str, Sequence[list[str]]], root: int, house: int, things: Sequence[Object]
) -> list[list[str]]:
    draws = stream(root, "recorded materials", house).random(len(things))
    choices = [materials.get(entity_name(thing["objectType"])) or [[]] for thing in things]
    return [among[int(draw * len(among))] for among, draw in zip(choices, draws.tolist(), strict=True)]


def numbered(path: Path, sha256: str | None) -> Iterator[tuple[int, House, list[Placed]]]:
    """The houses of a file, by their lines, with their objects.

    Raises:
        InputError: where it is no file of houses, or the type of an object is not known.
    """
    types = asset_types()
    for line, house in houses(path, sha256):
        try:
            yield line, house, list(objects(house, types))
        except InputError as error:
            raise InputError(path, f"line {line}", str(error)) from error


def mine(
    read: Iterable[tuple[int, House, list[Placed]]],
    affordances: Mapping[str, Sequence[str]],
    drawn: MaterialsOf,
    left: Counter[str],
) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per ``CHUNK`` houses, in their order.

    Args:
        read: houses, by line, with their objects; as many as there are, since only one is held at once.
        affordances: of each name of a type that was recorded.
        drawn: materials of each object of a house, in the order of the objects.
        left: grows by what is left out, and by what is odd.
    """
    rest = iter(read)
    for first in rest:
        yield part([
            row
            for number, house, things in chain([first], islice(rest, CHUNK - 1))
            for row in _observations(number, in_rooms(house, things, left), affordances, drawn, left)
        ])  # fmt: skip


def in_rooms(house: House, things: Iterable[Placed], left: Counter[str]) -> list[tuple[Placed, str]]:
    """Objects with the name of the room whose floor they are on or above; those in no room are left out."""
    ids: set[str] = set()
    rooms = {room.id: room for room in house.rooms}
    placed = []
    for thing in things:
        left[INSTANCES] += 1
        room = _room_of(thing, rooms)
        if thing.id in ids:
            left[TAKEN] += 1
        elif room is None:
            left[OUTSIDE] += 1
        else:
            left[UNNAMED] += thing.room not in rooms
            left[ELSEWHERE] += thing.room in rooms and thing.room != room.id
            placed.append((thing, entity_name(room.type)))
        ids.add(thing.id)
    return placed


def _room_of(thing: Placed, rooms: Mapping[str, Room]) -> Room | None:
    """The room that holds an object, or else that it borders; of several, the one that its id names, or the first."""
    named = rooms.get(thing.room or "")
    order = [named, *rooms.values()] if named else list(rooms.values())
    held = next((room for room in order if room.holds(thing.position)), None)
    return held or next((room for room in order if room.borders(thing.position)), None)


def _observations(
    number: int,
    things: Sequence[tuple[Placed, str]],
    affordances: Mapping[str, Sequence[str]],
    drawn: MaterialsOf,
    left: Counter[str],
) -> Iterator[tuple[str | int, ...]]:
    scene = f"House{number}"
    all_materials = drawn(number, [{"objectType": thing.type} for thing, _ in things])
    for (thing, room), materials in zip(things, all_materials, strict=True):
        head = entity_name(thing.type)
        if head not in affordances:
            left[UNRECORDED + head] += 1
        tails = {
            AT_LOCATION: [room, entity_name(thing.parent)] if thing.parent else [room],
            HAS_MATERIAL: materials,
            HAS_AFFORDANCE: affordances.get(head, ()),
        }
        for relation, answers in tails.items():
            for tail in answers:
                yield scene, room, thing.id, head, relation, tail, 1
