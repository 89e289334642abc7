"""AI2-THOR scenes as the simulator reported them, mined into observations (section 5.1)."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from isi.base import paths
from isi.base.errors import InputError
from isi.base.params import Sha256
from isi.sources import Mining, part, source
from isi.sources._household import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, entity_name, household
from isi.sources._materials import MaterialsOf, Object, read_shares, simulator, suncg

FLOOR = "floor"
SCENES_PER_ROOM = 30
#: Scenes mined as one: a row group of the table.
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

#: What becomes of a receptacle that its scene lacks.
Broken = Literal["error", "drop"]
#: As what one that is dropped is counted.
DROPPED = "receptacles dropped that their scene lacks"

#: What mining reads of an object: the rest would only cost memory.
FIELDS = ("objectId", "objectType", "parentReceptacles", "salientMaterials", *AFFORDANCES)


@dataclass(frozen=True)
class Scene:
    """One floor plan: its name, number, room and the objects that the simulator reported, less what no one reads."""

    name: str
    number: int
    room: str
    objects: list[Object]


@source("ai2thor", entities=household)
def ai2thor(
    mining: Mining, from_: str, sha256: Sha256 | None, materials: Literal["suncg", "simulator"], broken: Broken
) -> Iterator[pa.Table]:
    """Observations of recorded scenes.

    Args:
        mining: its seed draws materials.
        from_: ``recording``, the one in the package ``procthor``, or the path of a JSON file of the same form.
        sha256: what the file must hash to, if it is to be checked.
        materials: drawn as in SUNCG, or as the simulator reports them.
        broken: what becomes of a receptacle that its scene lacks.
    """
    path = locate(from_)
    scenes, dropped = read_recording(path, sha256), mining.left if broken == "drop" else None
    if materials == "simulator":
        return mine(scenes, simulator, path, dropped)
    shares = read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)
    return mine(scenes, suncg(shares, mining.seed), path, dropped)


def locate(from_: str) -> Path:
    """Path of a recording: that in the ``procthor`` package (never imported), or as given."""
    if from_ != "recording":
        return Path(from_)
    try:
        found = distribution("procthor").locate_file("procthor/databases/ai2thor-object-metadata.json")
    except PackageNotFoundError as error:
        raise InputError("package procthor", "", "not installed, which has the recording of the scenes") from error
    return Path(str(found))


def read_recording(path: Path, sha256: str | None) -> list[Scene]:
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
    if sha256 and got != sha256:
        raise InputError(path, "", f"expected {sha256} as its sha256, got {got}")
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
    scenes: Iterable[Scene], materials_of: MaterialsOf, file: Path, dropped: Counter[str] | None = None
) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per ``CHUNK`` scenes, in their order.

    Args:
        scenes: what to mine; as many as there are, since only a chunk is held at once.
        materials_of: materials of each object of a scene, in the order of the objects.
        file: named in errors.
        dropped: grows by the receptacles that are left out, since their scene lacks them; null: such a one is an error.

    Raises:
        InputError: where an object lies in a receptacle that its scene lacks.
    """
    rest = iter(scenes)
    while chunk := list(islice(rest, CHUNK)):
        yield part([row for scene in chunk for row in _observations(scene, materials_of, file, dropped)])


def _observations(
    scene: Scene, materials_of: MaterialsOf, file: Path, dropped: Counter[str] | None
) -> Iterator[tuple[str | int, ...]]:
    names = {thing["objectId"]: entity_name(thing["objectType"]) for thing in scene.objects}
    for thing, materials in zip(scene.objects, materials_of(scene.number, scene.objects), strict=True):
        head = names[thing["objectId"]]
        if head == FLOOR:
            continue
        tails = {
            AT_LOCATION: [scene.room, *_receptacles(scene, thing, names, file, dropped)],
            HAS_MATERIAL: materials,
            HAS_AFFORDANCE: [a for prop, pair in AFFORDANCES.items() if thing.get(prop) for a in pair],
        }
        for relation, answers in tails.items():
            for tail in answers:
                yield scene.name, scene.room, thing["objectId"], head, relation, tail, 1


def _receptacles(
    scene: Scene, thing: Object, names: dict[str, str], file: Path, dropped: Counter[str] | None
) -> Iterator[str]:
    for parent in thing.get("parentReceptacles") or ():
        if parent not in names and dropped is not None:
            dropped[DROPPED] += 1
        elif parent not in names:
            place = f"{scene.name}, object {thing['objectId']}"
            raise InputError(file, place, f"its parent receptacle {parent!r} is not in the scene")
        elif names[parent] != FLOOR:
            yield names[parent]
