"""One scene of AI2-THOR as the simulator reported it: a list of objects, or metadata that hold one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from isi.errors import InputError
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._json import json_of
from isi.sources._materials import simulator
from isi.sources._mining import Broken, Circular, Untidy, mine
from isi.sources._naming import fault
from isi.sources._recording import ITHOR, ROBOTHOR, Scene, checked
from isi.sources._rows import read_text

#: As what objects are counted where nothing says which room they are in.
ROOMLESS = "objects without a room: neither the scene's name nor the setting room tells it"


@source("ai2thor_scene", entities=household)
def ai2thor_scene(
    mining: Mining, path: str, room: str | None = None, broken: Broken = "error", circular: Circular = "keep"
) -> Iterator[pa.Table]:
    """Observations of one scene, with the materials that the simulator reports.

    Args:
        mining: counts what is left out.
        path: of JSON (``.gz`` behind it or not): a list of objects, ``event.metadata``, or a line of a recording.
        room: which the scene is; else that of its name, where it has one such as ``FloorPlan1``.
        broken: what becomes of a receptacle that the scene lacks, and of contents that are not there or elsewhere.
        circular: what becomes of a receptacle that lies in what it holds.
    """
    wrong = fault(room) if room else None
    if wrong:
        raise InputError("room", "", wrong)
    scene = read_scene(Path(path), room)
    for table in mine([scene], simulator, Path(path), Untidy(broken, circular, mining.left)):
        if not scene.room:
            mining.left[ROOMLESS] = len(scene.objects)
        yield table if scene.room else _without_room(table)


def _without_room(table: pa.Table) -> pa.Table:
    rooms = pa.nulls(table.num_rows, pa.string()).dictionary_encode()
    plain = table.set_column(table.schema.get_field_index("room"), table.schema.field("room"), rooms)
    return plain.filter(pc.not_equal(plain["tail"].cast(pa.string()), ""))


def read_scene(path: Path, room: str | None) -> Scene:
    """The scene of a file; its room is empty where nothing tells it.

    Raises:
        InputError: where the file is missing, too large, no JSON, or holds no objects of AI2-THOR.
    """
    found = json_of(path, "", read_text(path, "a scene"))
    name, objects = _parts(found)
    wrong = fault(name)
    if wrong:
        raise InputError(path, "scene", wrong)
    if not isinstance(objects, list) or not objects:
        raise InputError(path, "", "expected a scene: a list of objects, or a mapping with the key objects")
    return Scene(name, 0, room or _room(name), checked(path, name, objects))


def _parts(found: Any) -> tuple[Any, Any]:
    """Name and objects of a scene, in any of its forms."""
    if isinstance(found, dict):
        found = found.get("metadata", found)
    if not isinstance(found, dict):
        return "scene", found
    return found.get("scene") or found.get("sceneName") or "scene", found.get("objects")


def _room(scene: str) -> str:
    """The room of a floor plan, however it is spawned; empty where the name is none of a floor plan."""
    plan = re.sub("_physics$|#[0-9]+$", "", scene)
    return next((plans.room for plans in (*ITHOR, *ROBOTHOR) if plan in plans.names), "")
