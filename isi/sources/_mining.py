"""Scenes of the simulator mined into observations (section 5.1), tidy or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal

import pyarrow as pa

from isi.base import paths
from isi.base.errors import InputError
from isi.sources import part
from isi.sources._household import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, entity_name
from isi.sources._materials import MaterialsOf, Object, read_shares, simulator, suncg
from isi.sources._recording import AFFORDANCES, Scene

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

    def receptacles(self, thing: Object) -> Iterator[str]:
        """Names of the receptacles that an object says it is in, but for the floor and for what is dropped."""
        for parent in thing.get("parentReceptacles") or ():
            if parent not in self._by_id:
                self._drop(self._untidy.broken, MISSING, thing, f"its parent receptacle {parent!r} is not in the scene")
                continue
            name = entity_name(self._by_id[parent]["objectType"])
            if name == FLOOR:
                continue
            if self._untidy.circular != "keep" and self._lies_in(parent, thing["objectId"]):
                self._drop(self._untidy.circular, IN_CIRCLE, thing, f"its parent receptacle {parent!r} lies in it")
                continue
            yield name

    def check_contents(self) -> None:
        """See that what receptacles list is there and says so itself; observations are what it says itself."""
        for thing in self._scene.objects:
            for inside in thing.get("receptacleObjectIds") or ():
                if inside not in self._by_id:
                    self._drop(self._untidy.broken, NOT_THERE, thing, f"it holds {inside!r}, which is not in the scene")
                elif thing["objectId"] not in (self._by_id[inside].get("parentReceptacles") or ()):
                    self._drop(self._untidy.broken, ELSEWHERE, thing, f"it holds {inside!r}, which lies elsewhere")

    def _lies_in(self, inner: str, outer: str) -> bool:
        """Whether an object is, itself or through its receptacles, in another, or is that other."""
        waiting, seen = [inner], set()
        while waiting:
            current = waiting.pop()
            if current == outer:
                return True
            if current in self._by_id and current not in seen:
                seen.add(current)
                waiting += self._by_id[current].get("parentReceptacles") or ()
        return False

    def _drop(self, how: Broken | Circular, what: str, thing: Object, problem: str) -> None:
        """Count something, or refuse it."""
        if how == "error":
            raise InputError(self._file, f"{self._scene.name}, object {thing['objectId']}", problem)
        self._untidy.dropped[what] += 1
