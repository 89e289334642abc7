"""AI2-THOR scenes as the simulator reported them, mined into observations (section 5.1)."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import pyarrow as pa

from isi import paths
from isi.errors import InputError
from isi.scenes.chunks import chunked, map_in_order
from isi.tables import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, OBSERVATIONS

Object = dict[str, Any]
#: Gives the materials of an instance: from its scene's number and the objects of that scene.
MaterialsOf = Callable[[int, Sequence[Object]], list[list[str]]]

FLOOR = "floor"
SCENES_PER_ROOM = 30
#: Scenes mined as one: a row group of the table, and what a worker is sent at a time.
CHUNK = 120

#: Key of the recording, room, number of its first floor plan.
ROOMS = (
    ("kitchens", "kitchen", 1),
    ("living_rooms", "living room", 201),
    ("bedrooms", "bedroom", 301),
    ("bathrooms", "bathroom", 401),
)

#: What can be done with an object that has a property.
AFFORDANCES = {
    "openable": ("open", "close"),
    "pickupable": ("pick up", "put"),
    "toggleable": ("turn on", "turn off"),
    "canFillWithLiquid": ("fill", "empty"),
    "sliceable": ("slice",),
    "breakable": ("break",),
    "dirtyable": ("clean", "dirty"),
    "moveable": ("push", "pull"),
    "cookable": ("cook",),
    "isHeatSource": ("heat",),
    "isColdSource": ("cool",),
}

#: What mining reads of an object: the rest would only cost memory, and time on the way to a worker.
FIELDS = ("objectId", "objectType", "parentReceptacles", "salientMaterials", *AFFORDANCES)


@dataclass(frozen=True)
class Scene:
    """One floor plan: its name, number, room and the objects that the simulator reported, less what no one reads."""

    name: str
    number: int
    room: str
    objects: list[Object]


@cache
def entity_name(object_type: str) -> str:
    """Lower-case words of a type in camel case: ``TVStand`` → ``tv stand``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type).lower()


def locate(recording: str) -> Path:
    """Path of the recording: that of the ``procthor`` package (never imported), or as given."""
    if recording != "procthor":
        return Path(recording)
    try:
        found = distribution("procthor").locate_file("procthor/databases/ai2thor-object-metadata.json")
    except PackageNotFoundError as error:
        raise InputError(paths.PARAMS, "ai2thor.recording", "the package procthor is not installed") from error
    return Path(str(found))


def read_recording(path: Path, sha256: str) -> list[Scene]:
    """The 120 iTHOR scenes of a recording, in the order of their floor plans.

    Raises:
        InputError: where the file is missing, hashes to something else, is no JSON, or lacks scenes.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, "", f"expected a recording of AI2-THOR's scenes ({error.strerror})") from error
    try:
        recording = json.loads(content)
    except ValueError as error:
        raise InputError(path, "", f"expected JSON: {error}") from error
    got = hashlib.sha256(content).hexdigest()
    if got != sha256:
        raise InputError(path, "", f"expected SHA-256 {sha256} (params.yaml: ai2thor.sha256), got {got}")
    return [scene for key, room, first in ROOMS for scene in _scenes(path, recording, key, room, first)]


def _scenes(path: Path, recording: Any, key: str, room: str, first: int) -> Iterator[Scene]:
    scenes = recording.get(key) if isinstance(recording, dict) else None
    if not isinstance(scenes, list) or len(scenes) != SCENES_PER_ROOM:
        got = f"{len(scenes)}" if isinstance(scenes, list) else "none"
        raise InputError(path, key, f"expected a list of {SCENES_PER_ROOM} scenes, got {got}")
    for number, objects in enumerate(scenes, first):
        name = f"FloorPlan{number}"
        if not isinstance(objects, list):
            raise InputError(path, name, "expected a list of objects")
        for place, thing in enumerate(objects):
            _check(path, name, place, thing)
        yield Scene(name, number, room, [_stripped(thing) for thing in objects])


def _check(path: Path, scene: str, place: int, thing: Any) -> None:
    where = thing.get("objectId") if isinstance(thing, dict) else None
    if not isinstance(where, str) or not where:
        raise InputError(path, f"{scene}, object {place}", "expected an object with an objectId")
    if not isinstance(thing.get("objectType"), str) or not thing["objectType"]:
        raise InputError(path, f"{scene}, object {where}", "has no objectType")
    for key in ("parentReceptacles", "salientMaterials"):
        named = thing.get(key) or []
        if not isinstance(named, list) or not all(isinstance(name, str) for name in named):
            raise InputError(path, f"{scene}, object {where}", f"expected {key} to be a list of names or null")


def _stripped(thing: Object) -> Object:
    return {key: thing[key] for key in FIELDS if thing.get(key)}


def mine(
    scenes: Iterable[Scene], materials_of: MaterialsOf, source: Path, executor: Executor | None = None
) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per ``CHUNK`` scenes, in their order.

    Args:
        scenes: what to mine; as many as there are, since only a few chunks are held at once.
        materials_of: materials of each object of a scene, in the order of the objects.
        source: named in errors.
        executor: where to mine; here, without one. The tables are the same.

    Raises:
        InputError: where an object lies in a receptacle that its scene lacks.
    """
    return map_in_order(partial(_mine, materials_of, source), chunked(scenes, CHUNK), executor)


def _mine(materials_of: MaterialsOf, source: Path, scenes: Sequence[Scene]) -> pa.Table:
    rows = [row for scene in scenes for row in _observations(scene, materials_of, source)]
    columns = zip(*rows, strict=True) if rows else [()] * len(OBSERVATIONS)
    arrays = [pa.array(column, field.type) for column, field in zip(columns, OBSERVATIONS, strict=True)]
    return pa.Table.from_arrays(arrays, schema=OBSERVATIONS)


def _observations(scene: Scene, materials_of: MaterialsOf, source: Path) -> Iterator[tuple[str | int, ...]]:
    names = {thing["objectId"]: entity_name(thing["objectType"]) for thing in scene.objects}
    for thing, materials in zip(scene.objects, materials_of(scene.number, scene.objects), strict=True):
        head = names[thing["objectId"]]
        if head == FLOOR:
            continue
        tails = {
            AT_LOCATION: [scene.room, *_receptacles(scene, thing, names, source)],
            HAS_MATERIAL: materials,
            HAS_AFFORDANCE: [a for prop, pair in AFFORDANCES.items() if thing.get(prop) for a in pair],
        }
        for relation, answers in tails.items():
            for tail in answers:
                yield scene.name, scene.room, thing["objectId"], head, relation, tail, 1


def _receptacles(scene: Scene, thing: Object, names: dict[str, str], source: Path) -> Iterator[str]:
    for parent in thing.get("parentReceptacles") or ():
        if parent not in names:
            place = f"{scene.name}, object {thing['objectId']}"
            raise InputError(source, place, f"its parent receptacle {parent!r} is not in the scene")
        if names[parent] != FLOOR:
            yield names[parent]
