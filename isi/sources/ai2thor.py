"""Observations of AI2-THOR's and RoboTHOR's scenes,
from recordings or single files (section 5.1 of the paper).
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, compress, starmap
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from isi.config import Sha256
from isi.errors import InputError, at, cut, short
from isi.names import name_fault
from isi.random import stream
from isi.sources import Mining, Observation, observed, once, reader
from isi.sources.names import Label, household
from isi.sources.readers import MOST, json_lines, parse_json, read_table, refuse
from isi.sources.recordings import (
    AFFORDANCES,
    SIMULATORS,
    Scene,
    SceneObject,
    absent_properties,
    locate,
    read_recording,
    scene_objects,
)
from isi.tables import paths

FLOOR = "floor"
#: Setting: sample from SUNCG's shares, or use the reported ones.
Materials = Literal["suncg", "simulator"]
#: Settings for invalid containment. Broken: the receptacle or the content is not in the scene or is
#: the object itself, or a listed content does not list the receptacle. Circular: two objects
#: contain each other, perhaps through others.
Broken = Literal["error", "drop"]
Circular = Literal["keep", "error", "drop"]
OBJECTS = "expected a non-empty list of objects, or a mapping with such a list as 'objects'"
ABSENT = "properties that no object reports, so that their affordances are missing"
EMPTY = "events dropped without objects"
ROOMLESS = "objects without a room: neither the scene's name nor the setting room gives it"
#: Problems of containment: name of the count where it is dropped, and message of the error where it
#: is refused.
PROBLEMS = {
    "receptacles dropped that are not in the scene": "its parent receptacle {} is not in the scene",
    "receptacles dropped that are the object itself": "it is its own parent receptacle",
    "receptacles dropped that lie in the object": "its parent receptacle {} lies in it",
    "contents dropped that are not in the scene": "it holds {}, which is not in the scene",
    "contents dropped that do not list the receptacle": (
        "it holds {}, which does not list it as receptacle"
    ),
}
MISSING, ITSELF, IN_CYCLE, NOT_THERE, ELSEWHERE = PROBLEMS
#: Number of a scene, and its objects → the materials of each object.
MaterialsOf = Callable[[int, Sequence[SceneObject]], list[Sequence[str]]]


def _register(simulator: str) -> None:
    """Register a reader of a simulator's recorded scenes, under the simulator's name."""
    file_alone = {"sha256": None, "materials": "simulator", "broken": "error"}

    @reader(simulator, household, path="from_", defaults=file_alone)
    def read(
        mining: Mining,
        from_: str,
        sha256: Sha256 | None,
        materials: Materials,
        broken: Broken,
        circular: Circular = "keep",
    ) -> Iterator[Observation]:
        """Observations of recorded scenes.

        ``from_`` is ``recording`` (in the package ``procthor``), ``simulator`` (of
        ``make record``), or the path of a file in either format. ``sha256`` is the expected hash of
        the file; None: no check. The package's iTHOR has fourteen ``circular`` observations, of
        cabinets that overlap.
        """
        path = locate(from_, simulator)
        scenes = read_recording(path, sha256, SIMULATORS[simulator])
        return mine(
            scenes, materials_of(materials, mining.seed), path, mining.counts, broken, circular
        )


def _is_event(value: Any) -> bool:
    return isinstance(value, dict) and not {"objects", "metadata"}.isdisjoint(value)


_register("ai2thor")
_register("robothor")


@reader("ai2thor_scene", household, path="path")
def ai2thor_scene(
    mining: Mining,
    path: str,
    room: Label | None = None,
    broken: Broken = "error",
    circular: Circular = "keep",
) -> Iterator[Observation]:
    """Observations of scenes, with the materials that the simulator reports.

    ``path`` is a JSON file (or ``.json.gz``): a list of objects, ``event.metadata``, or a line of a
    recording; or a list of these, or JSON Lines, where an observation that is in several events of
    a scene counts once. ``room`` is the scene's room; None: that of the floor plan with the scene's
    name (``FloorPlan1``: kitchen), if any.
    """
    file = Path(path)
    absent: set[str] | None = None  # properties that no object reports; None: no objects yet

    def observations(place: str, event: Any) -> list[Observation]:
        nonlocal absent
        fields = _fields(event)
        if "objects" in fields and fields["objects"] in (None, []):
            mining.counts[EMPTY] += 1
            return []
        with at(path, place):
            scene = _scene(file, fields, room)
            without = set(absent_properties(fields["objects"]))
            absent = without if absent is None else absent & without
            mining.counts.update([ROOMLESS] * (0 if scene.room else len(scene.objects)))
            return list(mine([scene], reported_materials, file, mining.counts, broken, circular))

    yield from once(starmap(observations, _events(file)), mining.counts)
    if absent is None:
        raise InputError(path, "", OBJECTS)
    if absent:
        mining.counts[f"{ABSENT}: {', '.join(name for name in AFFORDANCES if name in absent)}"] = (
            len(absent)
        )


def _events(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield (place, event) for each event of a file."""
    for number, content in json_lines(path, MOST, "a scene"):
        place = f"line {number}" * (number > 1)
        value = parse_json(Any, content, path, place)
        if isinstance(value, list) and any(map(_is_event, value)):
            yield from ((f"event {index}", event) for index, event in enumerate(value))
        else:
            yield place, value


def _fields(event: Any) -> Mapping[str, Any]:
    """The fields of an event: those of its metadata, or only the objects.
    An event of a simulator may lack them.
    """
    is_event = isinstance(event, dict) and "metadata" in event
    content = event["metadata"] if is_event else event
    if not isinstance(content, dict):
        return {"objects": content} if content is not None else {}
    return {"objects": []} | content if is_event else content


def _scene(path: Path, fields: Mapping[str, Any], room: str | None) -> Scene:
    name = fields.get("scene") or fields.get("sceneName") or "scene"
    reported = fields.get("objects")
    if fault := name_fault(name):
        raise InputError(path, "scene", fault)
    if not isinstance(reported, list) or not reported:
        raise InputError(path, "", OBJECTS)
    plan = re.sub("_physics$|#[0-9]+$", "", name)
    of_plan = next((plans.room for plans in chain(*SIMULATORS.values()) if plan in plans.names), "")
    return Scene(name, 0, room or of_plan, scene_objects(path, name, reported))


def mine(
    scenes: Iterable[Scene],
    materials_of: MaterialsOf,
    file: Path,
    counts: Counter[str],
    broken: Broken = "error",
    circular: Circular = "keep",
) -> Iterator[Observation]:
    """Yield observations, scene by scene; ``counts`` counts dropped containment by problem;
    errors name ``file``.
    """
    for scene in scenes:
        things = {thing.id: thing for thing in scene.objects}
        receptacles: dict[str, list[str]] = {name: [] for name in things}
        for name, other, fault in _containment(things, find_cycles=circular != "keep"):
            if not fault:
                receptacles[name].append(things[other].name)
            elif (circular if fault == IN_CYCLE else broken) == "error":
                remedy = f"--set {'circular' if fault == IN_CYCLE else 'broken'}=drop drops it"
                problem = f"{PROBLEMS[fault].format(short(other))}; {remedy}"
                raise InputError(file, f"{scene.name}, object {cut(name)}", problem)
            else:
                counts[fault] += 1
        for thing, materials in zip(
            scene.objects, materials_of(scene.number, scene.objects), strict=True
        ):
            if thing.name != FLOOR:
                seen = receptacles[thing.id], materials, thing.affordances
                yield from observed(scene.name, scene.room or None, thing.id, thing.name, *seen)


def _containment(
    things: Mapping[str, SceneObject], find_cycles: bool
) -> Iterator[tuple[str, str, str | None]]:
    """Yield (id, id of its receptacle or invalid content, key of ``PROBLEMS`` or None);
    a floor is no receptacle.
    """
    inside = {name: frozenset(thing.receptacles) for name, thing in things.items()}
    # equal for objects that contain each other, perhaps through others
    cycle_of: dict[str, int] = {}
    if find_cycles:
        import networkx as nx  # imported here: few calls need it

        graph = nx.DiGraph(
            (name, other) for name, others in inside.items() for other in others if other in things
        )
        parts = enumerate(nx.strongly_connected_components(graph))
        cycle_of = {name: number for number, part in parts for name in part}
    for name, thing in things.items():
        for content in thing.contents:
            if content not in things or name not in inside[content]:
                yield name, content, ELSEWHERE if content in things else NOT_THERE
    for name, thing in things.items():
        for other in thing.receptacles if thing.name != FLOOR else ():
            if other not in things or other == name:
                yield name, other, ITSELF if other == name else MISSING
            elif things[other].name != FLOOR:
                yield (
                    name,
                    other,
                    IN_CYCLE if cycle_of.get(other, other) == cycle_of.get(name, name) else None,
                )


def materials_of(materials: Materials, seed: int) -> MaterialsOf:
    """The function that gives objects their materials:
    sampled from SUNCG's shares, or reported by the simulator.
    """
    if materials == "simulator":
        return reported_materials
    return suncg_materials(read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES), seed)


def reported_materials(_scene: int, objects: Sequence[SceneObject]) -> list[Sequence[str]]:
    """The materials that the simulator reports."""
    return [thing.materials for thing in objects]


def suncg_materials(shares: pd.DataFrame, root: int) -> MaterialsOf:
    """Sample each material of an object with probability shares[object, material];
    one random stream per scene.
    """
    table = np.vstack([shares.to_numpy(dtype=float), np.zeros(shares.shape[1])])

    def draw(scene: int, objects: Sequence[SceneObject]) -> list[Sequence[str]]:
        names = pd.Index([thing.name for thing in objects], dtype=shares.index.dtype)
        rows = shares.index.get_indexer(names)  # without shares: -1, the last row, all 0
        drawn = stream(root, "materials", scene).random((len(rows), shares.shape[1])) < table[rows]
        return [list(compress(shares.columns, has_material)) for has_material in drawn.tolist()]

    return draw


def read_shares(shares: Path, categories: Path) -> pd.DataFrame:
    """Share of instances with each material, in [0, 1]:
    one row per object name, one column per material.

    ``shares``: CSV ``concept,material,share``. ``categories``: CSV ``object,category``; a category
    must be a concept.
    """
    rows = read_table(shares, ["concept", "material", "share"], ["concept", "material"])
    wrong = ~pd.to_numeric(rows["share"], errors="coerce").between(0, 1)
    refuse(shares, rows["share"], wrong, "expected a number from 0 to 1 as share")
    table = rows.assign(share=rows["share"].map(float)).pivot(
        index="concept", columns="material", values="share"
    )
    mapping = read_table(categories, ["object", "category"], ["object"])
    refuse(
        categories,
        mapping["category"],
        ~mapping["category"].isin(table.index),
        "expected a category with shares",
    )
    return table.loc[mapping["category"]].set_axis(pd.Index(mapping["object"]), axis=0).fillna(0.0)
