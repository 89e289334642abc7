"""AI2-THOR's and RoboTHOR's scenes, recorded or one by one, mined into observations (section 5.1)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from isi.config import Sha256
from isi.errors import InputError, cut, short
from isi.sources import Mining, Observation, observed, reader
from isi.sources.materials import Materials, MaterialsOf, materials_of, reported_materials
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, Name, entity_name, household, name_fault
from isi.sources.readers import parse_json, read_text
from isi.sources.recordings import (  # fmt: skip
    AFFORDANCES,
    ITHOR,
    ROBOTHOR,
    FloorPlans,
    Scene,
    check_objects,
    locate,
    read_recording,
)

FLOOR = "floor"
#: Settings: what becomes of containment that cannot be, and of receptacles that lie in what they hold.
Broken = Literal["error", "drop"]
Circular = Literal["keep", "error", "drop"]
#: Under what it is counted when it is dropped.
MISSING = "receptacles dropped that their scene lacks"
ITSELF = "receptacles dropped that are what they hold"
IN_CYCLE = "receptacles dropped that lie in what they hold"
NOT_THERE = "contents of receptacles dropped that their scene lacks"
ELSEWHERE = "contents of receptacles dropped that lie elsewhere"
ROOMLESS = "objects without a room: neither the scene's name nor the setting room tells it"


@dataclass(frozen=True)
class CleaningRules:
    """What becomes of containment that cannot be, which a simulator may report."""

    #: a receptacle that its scene lacks or that is the object itself; contents that are not there or elsewhere
    broken: Broken = "error"
    #: a receptacle that lies, itself or through others, in what it holds
    circular: Circular = "keep"
    #: counts what is dropped
    counts: Counter[str] = field(default_factory=Counter)


def _reader_of(simulator: str, plans: Sequence[FloorPlans]) -> Callable[..., Iterator[Observation]]:
    def read(
        mining: Mining,
        from_: str,
        sha256: Sha256 | None,
        materials: Materials,
        broken: Broken,
        circular: Circular = "keep",
    ) -> Iterator[Observation]:
        """Observations of recorded scenes.

        Args:
            mining: its seed draws materials; counts what is dropped.
            from_: ``recording``, the one in the package ``procthor``; ``simulator``, the one of ``make record``; or the
                path of a file of either form.
            sha256: what the file must hash to, if it is to be checked.
            materials: drawn as in SUNCG, or as the simulator reports them.
            broken: see ``CleaningRules``.
            circular: likewise. The package's recording of iTHOR has fourteen such observations: cabinets that overlap,
                and a counter top that lies in the plate on it.
        """
        path = locate(from_, simulator)
        scenes, rules = read_recording(path, sha256, plans), CleaningRules(broken, circular, mining.counts)
        return mine(scenes, materials_of(materials, mining.seed), path, rules)

    return read


_FILE_ALONE = {"sha256": None, "materials": "simulator", "broken": "error"}
ai2thor = reader(
    "ai2thor",
    household,
    path="from_",
    reads_json=lambda value: isinstance(value, dict) and not {"format", "kitchens"}.isdisjoint(value),
    defaults=_FILE_ALONE,
)(_reader_of("ai2thor", ITHOR))
robothor = reader("robothor", household, path="from_", defaults=_FILE_ALONE)(_reader_of("robothor", ROBOTHOR))


def _is_scene(value: Any) -> bool:
    is_mapping = isinstance(value, dict) and "rooms" not in value and not {"objects", "metadata"}.isdisjoint(value)
    return isinstance(value, list) or is_mapping


@reader("ai2thor_scene", household, path="path", reads_json=_is_scene)
def ai2thor_scene(
    mining: Mining, path: str, room: Name | None = None, broken: Broken = "error", circular: Circular = "keep"
) -> Iterator[Observation]:
    """Observations of one scene, with the materials that the simulator reports.

    Args:
        mining: counts what is left out.
        path: of JSON (``.gz`` behind it or not): a list of objects, ``event.metadata``, or a line of a recording.
        room: which the scene is; else that of its name, where it has one such as ``FloorPlan1``.
        broken: see ``CleaningRules``.
        circular: likewise.
    """
    scene = read_scene(Path(path), room)
    if not scene.room:
        mining.counts[ROOMLESS] = len(scene.objects)
    yield from mine([scene], reported_materials, Path(path), CleaningRules(broken, circular, mining.counts))


def read_scene(path: Path, room: str | None) -> Scene:
    """The scene of a file; its room is empty where nothing tells it.

    Raises:
        InputError: where the file is missing, too large, no JSON, or holds no objects of AI2-THOR.
    """
    content: Any = parse_json(Any, read_text(path, "a scene"), path)
    if isinstance(content, dict):
        content = content.get("metadata", content)
    fields = content if isinstance(content, dict) else {"objects": content}
    name, objects = fields.get("scene") or fields.get("sceneName") or "scene", fields.get("objects")
    if fault := name_fault(name):
        raise InputError(path, "scene", fault)
    if not isinstance(objects, list) or not objects:
        raise InputError(path, "", "expected a scene: a list of objects, or a mapping with the key objects")
    plan = re.sub("_physics$|#[0-9]+$", "", name)
    of_plan = next((plans.room for plans in (*ITHOR, *ROBOTHOR) if plan in plans.names), "")
    return Scene(name, 0, room or of_plan, check_objects(path, name, objects))


def mine(
    scenes: Iterable[Scene], materials_of: MaterialsOf, file: Path, rules: CleaningRules | None = None
) -> Iterator[Observation]:
    """Observations of scenes, in their order; only one scene is held at once.

    Args:
        scenes: what to mine.
        materials_of: materials of each object of a scene, in the order of the objects.
        file: named in errors.
        rules: what becomes of containment that cannot be; null: it is an error, but for cycles, which stay.

    Raises:
        InputError: where an object lies where it cannot, and that is not to be dropped.
    """
    for scene in scenes:
        receptacles = receptacles_of(scene, file, rules or CleaningRules())
        for thing, materials in zip(scene.objects, materials_of(scene.number, scene.objects), strict=True):
            head = entity_name(thing["objectType"])
            if head == FLOOR:
                continue
            locations = [scene.room] * bool(scene.room) + receptacles[thing["objectId"]]
            affordances = [action for key, actions in AFFORDANCES.items() if thing.get(key) for action in actions]
            tails = (AT_LOCATION, locations), (HAS_MATERIAL, materials), (HAS_AFFORDANCE, affordances)
            yield from observed(scene.name, scene.room or None, thing["objectId"], head, tails)


def receptacles_of(scene: Scene, file: Path, rules: CleaningRules) -> dict[str, list[str]]:
    """Names of the receptacles that each object says it is in, by its id; without the floor and what is dropped.

    Raises:
        InputError: where containment cannot be, and the rules say that this is an error.
    """
    by_id = {thing["objectId"]: thing for thing in scene.objects}
    parents = {name: list(thing.get("parentReceptacles") or ()) for name, thing in by_id.items()}
    cycle_of = _cycles(parents) if rules.circular != "keep" else {}

    def drop(action: Broken | Circular, what: str, name: str, problem: str) -> None:
        if action == "error":
            raise InputError(file, f"{scene.name}, object {cut(name)}", problem)
        rules.counts[what] += 1

    for name, thing in by_id.items():
        for content in thing.get("receptacleObjectIds") or ():
            if content not in by_id:
                drop(rules.broken, NOT_THERE, name, f"it holds {short(content)}, which is not in the scene")
            elif name not in parents[content]:
                drop(rules.broken, ELSEWHERE, name, f"it holds {short(content)}, which lies elsewhere")
    receptacles: dict[str, list[str]] = {name: [] for name in by_id}
    for name, thing in by_id.items():
        if entity_name(thing["objectType"]) == FLOOR:
            continue
        for parent in parents[name]:
            if parent not in by_id:
                drop(rules.broken, MISSING, name, f"its parent receptacle {short(parent)} is not in the scene")
            elif parent == name:
                drop(rules.broken, ITSELF, name, "it is its own parent receptacle")
            elif (receptacle := entity_name(by_id[parent]["objectType"])) == FLOOR:
                continue
            elif cycle_of and cycle_of[parent] == cycle_of[name]:
                drop(rules.circular, IN_CYCLE, name, f"its parent receptacle {short(parent)} lies in it")
            else:
                receptacles[name].append(receptacle)
    return receptacles


def _cycles(parents: Mapping[str, Collection[str]]) -> dict[str, int]:
    """A number for each object, the same for those that lie, themselves or through others, in each other."""
    import networkx as nx  # here, since few ask for it

    graph = nx.DiGraph([(name, parent) for name, listed in parents.items() for parent in listed if parent in parents])
    graph.add_nodes_from(parents)
    return {name: number for number, cycle in enumerate(nx.strongly_connected_components(graph)) for name in cycle}
