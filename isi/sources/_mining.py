"""Scenes of the simulator mined into observations (section 5.1), tidy or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal

import pyarrow as pa

from isi.config import Sha256
from isi.errors import InputError, cut, short
from isi.sources import Mining, part
from isi.sources._household import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, entity_name
from isi.sources._materials import MaterialsOf, Object, read_shares, simulator, suncg
from isi.sources._recording import AFFORDANCES, Plans, Scene, locate, read_recording
from isi.tables import paths

FLOOR = "floor"
#: Scenes mined as one: a row group of the table.
CHUNK = 120

#: Whose materials: drawn as in SUNCG, or as the simulator reports them.
Materials = Literal["suncg", "simulator"]
#: What becomes of a receptacle that its scene lacks, and of what is listed as in one and is not there or elsewhere.
Broken = Literal["error", "drop"]
#: What becomes of a receptacle that lies, itself or through others, in what it holds.
Circular = Literal["keep", "error", "drop"]
#: As what it is counted when it is dropped.
MISSING = "receptacles dropped that their scene lacks"
ITSELF = "receptacles dropped that are what they hold"
IN_CIRCLE = "receptacles dropped that lie in what they hold"
NOT_THERE = "contents of receptacles dropped that their scene lacks"
ELSEWHERE = "contents of receptacles dropped that lie elsewhere"


@dataclass(frozen=True)
class Untidy:
    """What becomes of what a simulator says that cannot be."""

    broken: Broken = "error"
    circular: Circular = "keep"
    #: grows by what is dropped
    dropped: Counter[str] = field(default_factory=Counter)


def materials_of(materials: Materials, seed: int) -> MaterialsOf:
    """The materials of objects: drawn from a seed, or as the simulator reports them."""
    if materials == "simulator":
        return simulator
    return suncg(read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES), seed)


def of_recordings(simulator: str, plans: Sequence[Plans]) -> Callable[..., Iterator[pa.Table]]:
    """A source that reads recordings of some floor plans."""

    def observe(
        mining: Mining,
        from_: str,
        sha256: Sha256 | None,
        materials: Materials,
        broken: Broken,
        circular: Circular = "keep",
    ) -> Iterator[pa.Table]:
        """Observations of the recorded scenes.

        Args:
            mining: its seed draws materials; counts what is dropped.
            from_: ``recording``, the one in the package ``procthor``; ``simulator``, the one of ``make record``; or the
                path of a file of either form.
            sha256: what the file must hash to, if it is to be checked.
            materials: drawn as in SUNCG, or as the simulator reports them.
            broken: what becomes of a receptacle that its scene lacks or that is the object itself, and of contents
                that are not there or elsewhere.
            circular: what becomes of a receptacle that lies in what it holds. The package's recording of iTHOR has
                fourteen such observations: cabinets that overlap, and a counter top that lies in the plate on it.
        """
        path = locate(from_, simulator)
        scenes = read_recording(path, sha256, plans)
        return mine(scenes, materials_of(materials, mining.seed), path, Untidy(broken, circular, mining.left))

    return observe


def mine(
    scenes: Iterable[Scene], materials_of: MaterialsOf, file: Path, untidy: Untidy | None = None
) -> Iterator[pa.Table]:
    """Observations in the columns of ``tables.OBSERVATIONS``: one table per ``CHUNK`` scenes, in their order.

    Args:
        scenes: what to mine; as many as there are, since only a chunk is held at once.
        materials_of: materials of each object of a scene, in the order of the objects.
        file: named in errors.
        untidy: what becomes of what cannot be; null: it is an error, but for circles, which stay.

    Raises:
        InputError: where an object lies where it cannot, and that is not to be dropped.
    """
    rest, rules = iter(scenes), untidy or Untidy()
    while chunk := list(islice(rest, CHUNK)):
        yield part([row for scene in chunk for row in _observations(scene, materials_of, file, rules)])


def _observations(
    scene: Scene, materials_of: MaterialsOf, file: Path, untidy: Untidy
) -> Iterator[tuple[str | int, ...]]:
    containment = _Containment(scene, file, untidy)
    containment.check_contents()
    for thing, materials in zip(scene.objects, materials_of(scene.number, scene.objects), strict=True):
        head = entity_name(thing["objectType"])
        if head == FLOOR:
            continue
        tails = {
            AT_LOCATION: [scene.room, *containment.receptacles(thing)],
            HAS_MATERIAL: materials,
            HAS_AFFORDANCE: [a for prop, pair in AFFORDANCES.items() if thing.get(prop) for a in pair],
        }
        for relation, answers in tails.items():
            for tail in answers:
                yield scene.name, scene.room, thing["objectId"], head, relation, tail, 1


class _Containment:
    """What lies in what in one scene."""

    def __init__(self, scene: Scene, file: Path, untidy: Untidy) -> None:
        self._scene, self._file, self._untidy = scene, file, untidy
        self._by_id: Mapping[str, Object] = {thing["objectId"]: thing for thing in scene.objects}
        self._parents = {name: frozenset(thing.get("parentReceptacles") or ()) for name, thing in self._by_id.items()}
        #: in one circle with which others each object is
        self._circle = _circles(self._parents) if untidy.circular != "keep" else {}

    def receptacles(self, thing: Object) -> Iterator[str]:
        """Names of the receptacles that an object says it is in, but for the floor and for what is dropped."""
        for parent in thing.get("parentReceptacles") or ():
            if parent not in self._by_id:
                problem = f"its parent receptacle {short(parent)} is not in the scene"
                self._drop(self._untidy.broken, MISSING, thing, problem)
                continue
            if parent == thing["objectId"]:
                self._drop(self._untidy.broken, ITSELF, thing, "it is its own parent receptacle")
                continue
            name = entity_name(self._by_id[parent]["objectType"])
            if name == FLOOR:
                continue
            if self._circle and self._circle[parent] == self._circle[thing["objectId"]]:
                self._drop(self._untidy.circular, IN_CIRCLE, thing, f"its parent receptacle {short(parent)} lies in it")
                continue
            yield name

    def check_contents(self) -> None:
        """See that what receptacles list is there and says so itself; observations are what it says itself."""
        for thing in self._scene.objects:
            for inside in thing.get("receptacleObjectIds") or ():
                if inside not in self._by_id:
                    problem = f"it holds {short(inside)}, which is not in the scene"
                    self._drop(self._untidy.broken, NOT_THERE, thing, problem)
                elif thing["objectId"] not in self._parents[inside]:
                    self._drop(self._untidy.broken, ELSEWHERE, thing, f"it holds {short(inside)}, which lies elsewhere")

    def _drop(self, how: Broken | Circular, what: str, thing: Object, problem: str) -> None:
        """Count something, or refuse it."""
        if how == "error":
            raise InputError(self._file, f"{self._scene.name}, object {cut(thing['objectId'])}", problem)
        self._untidy.dropped[what] += 1


def _circles(parents: Mapping[str, Collection[str]]) -> dict[str, int]:
    """A number for each object, the same for those that lie, themselves or through others, in each other."""
    import networkx as nx  # here, since few ask for it

    graph = nx.DiGraph([(name, parent) for name, listed in parents.items() for parent in listed if parent in parents])
    graph.add_nodes_from(parents)
    return {name: number for number, circle in enumerate(nx.strongly_connected_components(graph)) for name in circle}
