"""AI2-THOR's and RoboTHOR's scenes, from recordings or single files, mined into observations (section 5.1)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, compress
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from isi.config import Sha256
from isi.errors import InputError, cut, short
from isi.random import stream
from isi.sources import Mining, Observation, observed, reader
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, Name, entity_name, household, name_fault
from isi.sources.readers import parse_json, read_table, read_text, refuse
from isi.sources.recordings import AFFORDANCES, SIMULATORS, Scene, SceneObject, check_objects, locate, read_recording
from isi.tables import paths

FLOOR = "floor"
#: Settings: whose materials; and what becomes of containment that cannot be, which a simulator may report: of a
#: receptacle that its scene lacks or that is the object itself, and of contents that are not there or elsewhere
#: (broken); of a receptacle that lies, itself or through others, in what it holds (circular).
Materials = Literal["suncg", "simulator"]
Broken = Literal["error", "drop"]
Circular = Literal["keep", "error", "drop"]
MISSING = "receptacles dropped that their scene lacks"  #: Under what it is counted when it is dropped.
ITSELF = "receptacles dropped that are what they hold"
IN_CYCLE = "receptacles dropped that lie in what they hold"
NOT_THERE = "contents of receptacles dropped that their scene lacks"
ELSEWHERE = "contents of receptacles dropped that lie elsewhere"
ROOMLESS = "objects without a room: neither the scene's name nor the setting room tells it"
#: Gives the materials of each object of a scene, from the scene's number and the types of its objects.
MaterialsOf = Callable[[int, Sequence[SceneObject]], list[list[str]]]


def _register(simulator: str, **known: Any) -> None:
    """A reader of a simulator's recorded scenes."""
    file_alone = {"sha256": None, "materials": "simulator", "broken": "error"}

    @reader(simulator, household, path="from_", defaults=file_alone, **known)
    def read(
        mining: Mining, from_: str, sha256: Sha256 | None, materials: Materials, broken: Broken,
        circular: Circular = "keep",
    ) -> Iterator[Observation]:  # fmt: skip
        """Observations of recorded scenes.

        ``from_`` is ``recording``, the one in the package ``procthor``; ``simulator``, the one of ``make record``; or
        the path of a file of either form, which must hash to ``sha256`` where that is given. Fourteen observations of
        the package's iTHOR are ``circular``, of cabinets that overlap.
        """
        path = locate(from_, simulator)
        scenes = read_recording(path, sha256, SIMULATORS[simulator])
        return mine(scenes, materials_of(materials, mining.seed), path, mining.counts, broken, circular)


def _is_scene(value: Any) -> bool:
    is_mapping = isinstance(value, dict) and "rooms" not in value and not {"objects", "metadata"}.isdisjoint(value)
    return isinstance(value, list) or is_mapping


_register("ai2thor", reads_json=lambda value: isinstance(value, dict) and not {"format", "kitchens"}.isdisjoint(value))
_register("robothor")


@reader("ai2thor_scene", household, path="path", reads_json=_is_scene)
def ai2thor_scene(
    mining: Mining, path: str, room: Name | None = None, broken: Broken = "error", circular: Circular = "keep"
) -> Iterator[Observation]:
    """Observations of one scene, with the materials that the simulator reports.

    ``path`` is of JSON (``.gz`` behind it or not): a list of objects, ``event.metadata``, or a line of a recording.
    ``room`` is the scene's room; null: the one that its name stands for, such as ``FloorPlan1``.
    """
    file = Path(path)
    content: Any = parse_json(Any, read_text(file, "a scene"), file)
    if isinstance(content, dict):
        content = content.get("metadata", content)
    fields = content if isinstance(content, dict) else {"objects": content}
    name, objects = fields.get("scene") or fields.get("sceneName") or "scene", fields.get("objects")
    if fault := name_fault(name):
        raise InputError(path, "scene", fault)
    if not isinstance(objects, list) or not objects:
        raise InputError(path, "", "expected a scene: a list of objects, or a mapping with the key objects")
    plan = re.sub("_physics$|#[0-9]+$", "", name)
    of_plan = next((plans.room for plans in chain(*SIMULATORS.values()) if plan in plans.names), "")
    scene = Scene(name, 0, room or of_plan, check_objects(file, name, objects))
    if not scene.room:
        mining.counts[ROOMLESS] = len(scene.objects)
    yield from mine([scene], reported_materials, file, mining.counts, broken, circular)


def mine(
    scenes: Iterable[Scene], materials_of: MaterialsOf, file: Path, counts: Counter[str], broken: Broken = "error",
    circular: Circular = "keep",
) -> Iterator[Observation]:  # fmt: skip
    """Observations of scenes, which are read one by one; ``counts`` counts what is dropped, errors name ``file``."""
    for scene in scenes:
        receptacles: dict[str, list[str]] = {thing["objectId"]: [] for thing in scene.objects}
        for name, receptacle, fault in _containment(scene, find_cycles=circular != "keep"):
            if not fault:
                receptacles[name].append(receptacle)
            elif (circular if fault == IN_CYCLE else broken) == "error":
                raise InputError(file, f"{scene.name}, object {cut(name)}", receptacle)
            else:
                counts[fault] += 1
        for thing, materials in zip(scene.objects, materials_of(scene.number, scene.objects), strict=True):
            head, locations = entity_name(thing["objectType"]), receptacles[thing["objectId"]]
            if head != FLOOR:
                tails = {
                    AT_LOCATION: [scene.room, *locations] if scene.room else locations,
                    HAS_MATERIAL: materials,
                    HAS_AFFORDANCE: [act for key, acts in AFFORDANCES.items() if thing.get(key) for act in acts],
                }
                yield from observed(scene.name, scene.room or None, thing["objectId"], head, tails)


def _containment(scene: Scene, find_cycles: bool) -> Iterator[tuple[str, str, str | None]]:
    """(object, receptacle, None) for each containment but the floor's; (object, problem, fault) where it cannot be."""
    type_of = {thing["objectId"]: entity_name(thing["objectType"]) for thing in scene.objects}
    parents = {thing["objectId"]: thing.get("parentReceptacles") or [] for thing in scene.objects}
    inside = {name: frozenset(listed) for name, listed in parents.items()}
    cycle_of: dict[str, int] = {}  # alike for objects that lie, themselves or through others, in each other
    if find_cycles:
        import networkx as nx  # here, since few ask for it

        graph = nx.DiGraph((name, parent) for name, listed in parents.items() for parent in listed if parent in parents)
        parts = enumerate(nx.strongly_connected_components(graph))
        cycle_of = {name: number for number, part in parts for name in part}
    for thing in scene.objects:
        name = thing["objectId"]
        for content in thing.get("receptacleObjectIds") or ():
            if content not in parents:
                yield name, f"it holds {short(content)}, which is not in the scene", NOT_THERE
            elif name not in inside[content]:
                yield name, f"it holds {short(content)}, which lies elsewhere", ELSEWHERE
    for name, listed in parents.items():
        for parent in listed if type_of[name] != FLOOR else ():
            if parent not in parents:
                yield name, f"its parent receptacle {short(parent)} is not in the scene", MISSING
            elif parent == name:
                yield name, "it is its own parent receptacle", ITSELF
            elif type_of[parent] == FLOOR:
                continue
            elif cycle_of and cycle_of[parent] == cycle_of[name]:
                yield name, f"its parent receptacle {short(parent)} lies in it", IN_CYCLE
            else:
                yield name, type_of[parent], None


def materials_of(materials: Materials, seed: int) -> MaterialsOf:
    """How objects get their materials: drawn by SUNCG's shares, or as the simulator reports them."""
    if materials == "simulator":
        return reported_materials
    return suncg_materials(read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES), seed)


def reported_materials(_scene: int, objects: Sequence[SceneObject]) -> list[list[str]]:
    """The ``salientMaterials`` that the simulator reports, in lower case, each once."""
    return [list(dict.fromkeys(map(str.lower, thing.get("salientMaterials") or ()))) for thing in objects]


def suncg_materials(shares: pd.DataFrame, root: int) -> MaterialsOf:
    """Draw each material of an object by the share of its category in SUNCG; one random stream per scene."""
    table = np.vstack([shares.to_numpy(dtype=float), np.zeros(shares.shape[1])])

    def draw(scene: int, objects: Sequence[SceneObject]) -> list[list[str]]:
        names = pd.Index([entity_name(thing["objectType"]) for thing in objects], dtype=shares.index.dtype)
        rows = shares.index.get_indexer(names)  # -1 is the last row
        drawn = stream(root, "materials", scene).random((len(rows), shares.shape[1])) < table[rows]
        return [list(compress(shares.columns, has_material)) for has_material in drawn.tolist()]

    return draw


def read_shares(shares: Path, categories: Path) -> pd.DataFrame:
    """Share of instances with each material: one row per object name, one column per material.

    ``shares`` is a CSV of ``concept,material,share`` (SUNCG categories), ``categories`` one of ``object,category``.
    """
    listed = read_table(shares, ["concept", "material", "share"], ["concept", "material"])
    wrong = ~pd.to_numeric(listed["share"], errors="coerce").between(0, 1)
    refuse(shares, listed["share"], wrong, "expected a number from 0 to 1 as share")
    listed["share"] = listed["share"].map(float)
    table = listed.pivot(index="concept", columns="material", values="share")
    mapping = read_table(categories, ["object", "category"], ["object"])
    refuse(categories, mapping["category"], ~mapping["category"].isin(table.index), "expected a category with shares")
    return table.loc[mapping["category"]].set_axis(pd.Index(mapping["object"]), axis=0).fillna(0.0)
