"""Scenes of AI2-THOR and RoboTHOR as recorded: by the package ``procthor``, or by ``make record``."""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any, TypeGuard

from isi.errors import InputError, cut, short
from isi.sources._files import check_sha256, packaged
from isi.sources._json import json_of
from isi.sources._materials import Object
from isi.sources._naming import fault
from isi.tables import paths

#: Header of a recording of ``make record``, a line of JSON; each line behind it is a scene.
FORMAT = {"format": "isi recording", "version": 1, "simulator": "ai2thor"}
GZIP = b"\x1f\x8b"
#: The longest line of a recording, in bytes (a thousand times the largest recorded scene's), and the largest JSON of
#: the package's form, which is held as a whole (three times the package's).
MOST_BYTES = 1 << 26
MOST_BYTES_WHOLE = 1 << 27
#: Objects of a scene, at most; those that are recorded have a few hundred.
MOST_OBJECTS = 100_000

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
LISTS = ("parentReceptacles", "receptacleObjectIds", "salientMaterials")
#: What mining reads of an object: the rest would only cost memory.
FIELDS = ("objectId", "objectType", *LISTS, *AFFORDANCES)
_TYPE = re.compile(r"[A-Za-z](?:[A-Za-z0-9_ -]{0,98}[A-Za-z0-9_-])?")
_LONGEST_ID = 1000
#: Of materials, since scenes name the same few over and over.
_fault = lru_cache(maxsize=4096)(fault)


@dataclass(frozen=True)
class Scene:
    """One floor plan: its name, number, room and the objects that the simulator reported, less what no one reads."""

    name: str
    number: int
    room: str
    objects: list[Object]


@dataclass(frozen=True)
class Plans:
    """Floor plans of one kind of room."""

    #: of their list in the package's recording
    key: str
    room: str
    #: number of the first
    first: int
    #: in the simulator
    names: tuple[str, ...]
    #: in the package's recording, where those are not known
    recorded: tuple[str, ...] = ()


ITHOR = tuple(
    Plans(key, room, first, tuple(f"FloorPlan{number}" for number in range(first, first + 30)))
    for key, room, first in (
        ("kitchens", "kitchen", 1),
        ("living_rooms", "living room", 201),
        ("bedrooms", "bedroom", 301),
        ("bathrooms", "bathroom", 401),
    )
)
#: One apartment each: nothing says in which of its rooms an object is. Nor does the package's recording say which
#: floor plan each of its scenes is, so they go by their place.
ROBOTHOR = (
    Plans(
        key="robothor",
        room="apartment",
        first=501,
        names=tuple(
            f"FloorPlan_{part}{walls}_{objects}"
            for part, number in (("Train", 12), ("Val", 3))
            for walls in range(1, number + 1)
            for objects in range(1, 6)
        ),
        recorded=tuple(f"RoboTHOR{place}" for place in range(1, 76)),
    ),
)


def locate(from_: str, simulator: str = "ai2thor") -> Path:
    """Path of a recording: that in the ``procthor`` package (never imported), that of ``make record``, or as given."""
    if from_ == "simulator":
        return paths.DATA / "recordings" / f"{simulator}.jsonl.gz"
    if from_ != "recording":
        return Path(from_)
    return packaged("procthor", "procthor/databases/ai2thor-object-metadata.json", "the recording of the scenes")


def read_recording(path: Path, sha256: str | None, plans: Sequence[Plans] = ITHOR) -> Iterator[Scene]:
    """Scenes of a recording of either form; of one of ``make record``, in its order and one by one.

    Args:
        path: of JSON as the package ``procthor`` has it, or of a recording of ``make record``.
        sha256: what the file must hash to, if it is to be checked.
        plans: which scenes; all those of the package's recording, and no others in one of ``make record``.

    Raises:
        InputError: where the file is missing, hashes to something else, is of neither form, or lacks scenes.
    """
    try:
        with path.open("rb") as file:
            check_sha256(path, file, sha256)
            compressed = file.read(len(GZIP)) == GZIP
    except OSError as error:
        raise InputError(path, "", f"expected a recording of AI2-THOR's scenes ({error.strerror})") from error
    return _of_recorder(path, plans) if compressed else _of_package(path, plans)


def _of_package(path: Path, plans: Iterable[Plans]) -> Iterator[Scene]:
    if path.stat().st_size > MOST_BYTES_WHOLE:
        raise InputError(path, "", f"expected at most {MOST_BYTES_WHOLE:,} bytes of JSON, or a recording by gzip")
    recording = json_of(path, "", path.read_bytes())
    for listed in plans:
        scenes = recording.get(listed.key) if isinstance(recording, dict) else None
        names = listed.recorded or listed.names
        if not isinstance(scenes, list) or len(scenes) != len(names):
            got = f"{len(scenes)}" if isinstance(scenes, list) else "none"
            raise InputError(path, listed.key, f"expected a list of {len(names)} scenes, got {got}")
        for number, (name, objects) in enumerate(zip(names, scenes, strict=True), listed.first):
            yield Scene(name, number, listed.room, checked(path, name, objects))


def _of_recorder(path: Path, plans: Iterable[Plans]) -> Iterator[Scene]:
    known = {name: (number, some.room) for some in plans for number, name in enumerate(some.names, some.first)}
    seen: set[str] = set()
    for place, (plan, spawn, objects) in enumerate(recorded(path), 2):
        if plan not in known:
            likely = f"expected one of this source's floor plans, such as {next(iter(known))}"
            raise InputError(path, f"line {place}", f"{likely}, got {short(plan)}")
        name, (number, room) = layout(plan, spawn), known[plan]
        wrong = f"{name} is there twice" if name in seen else fault(name)
        if wrong:
            raise InputError(path, f"line {place}", wrong)
        seen.add(name)
        yield Scene(name, number, room, checked(path, name, objects))
    if not seen:
        raise InputError(path, "", "expected scenes behind the header, got none")


def layout(plan: str, spawn: int | None) -> str:
    """Name of a floor plan as it is built, or of what a seed has made of it: ``FloorPlan1#3``."""
    return plan if spawn is None else f"{plan}#{spawn}"


def recorded(path: Path) -> Iterator[tuple[str, int | None, Any]]:
    """Floor plan, seed of its layout (null: as it is built) and objects of each line of a recording of ``make record``.

    Raises:
        InputError: where it is truncated or broken, or a line is of another form.
    """
    records = _lines(path)
    check_header(path, next(records, None))
    for place, record in enumerate(records, 2):
        yield check_line(path, place, record)


def check_header(path: Path, header: Any) -> None:
    """Refuse the first line of what is no recording of ``make record``, or one of another version."""
    got = {key: header.get(key) for key in FORMAT} if isinstance(header, dict) else header
    if got != FORMAT:
        raise InputError(path, "line 1", f"expected a header with {json.dumps(FORMAT)}, got {cut(short(got), 100)}")


def check_line(path: Path, place: int, record: Any) -> tuple[str, int | None, Any]:
    """Floor plan, seed and objects of one line."""
    if isinstance(record, dict):
        plan, spawn = record.get("scene"), record.get("spawn")
        if isinstance(plan, str) and plan and (spawn is None or type(spawn) is int) and "objects" in record:
            return plan, spawn, record["objects"]
    raise InputError(path, f"line {place}", "expected a scene, its spawn (a whole number or null) and its objects")


def _lines(path: Path) -> Iterator[Any]:
    try:
        with gzip.open(path, "rb") as file:
            for place in count(1):
                line = file.readline(MOST_BYTES + 1)
                if not line:
                    return
                yield parsed(path, place, line)
    except EOFError as error:
        raise InputError(path, "", "is cut short: `make record` goes on behind its last whole scene") from error
    except (OSError, zlib.error) as error:
        raise InputError(path, "", f"expected a recording, compressed by gzip ({error})") from error


def parsed(path: Path, place: int, line: bytes) -> Any:
    """JSON of one line."""
    if len(line) > MOST_BYTES:
        raise InputError(path, f"line {place}", f"expected at most {MOST_BYTES:,} bytes")
    return json_of(path, f"line {place}", line)


def checked(path: Path, scene: str, objects: Any) -> list[Object]:
    """Objects of a scene as mining takes them, with what it reads and without what is empty or false."""
    if not isinstance(objects, list) or len(objects) > MOST_OBJECTS:
        got = f"{len(objects):,}" if isinstance(objects, list) else short(objects)
        raise InputError(path, scene, f"expected a list of objects, of at most {MOST_OBJECTS:,}, got {got}")
    seen: set[str] = set()
    for place, thing in enumerate(objects):
        _check(path, scene, place, thing)
        if thing["objectId"] in seen:
            raise InputError(path, f"{scene}, object {cut(thing['objectId'])}", "is in its scene twice")
        seen.add(thing["objectId"])
    return [{key: thing[key] for key in FIELDS if thing.get(key)} for thing in objects]


def _check(path: Path, scene: str, place: int, thing: Any) -> None:
    identifier = thing.get("objectId") if isinstance(thing, dict) else None
    if not _is_name(identifier):
        least = f"an object with an objectId, printable and of at most {_LONGEST_ID} characters"
        raise InputError(path, f"{scene}, object {place}", f"expected {least}")
    where = f"{scene}, object {cut(identifier)}"
    if not isinstance(thing.get("objectType"), str) or not _TYPE.fullmatch(thing["objectType"]):
        got = short(thing.get("objectType"))
        raise InputError(path, where, f"expected its objectType to be a name, got {got}")
    for key in LISTS:
        named = thing.get(key) or []
        if not isinstance(named, list) or not all(map(_is_name, named)):
            raise InputError(path, where, f"expected {key} to be a list of names or null")
        if key != "salientMaterials" and len(set(named)) < len(named):
            raise InputError(path, where, f"expected {key} to name each once")
    for material in thing.get("salientMaterials") or ():
        if wrong := _fault(material):
            raise InputError(path, where, f"salientMaterials: {wrong}")
    for key in AFFORDANCES:
        if not isinstance(thing.get(key, False), bool):
            got = short(thing[key])
            raise InputError(path, where, f"expected {key} to be true or false, got {got}")


def _is_name(value: Any) -> TypeGuard[str]:
    return isinstance(value, str) and 0 < len(value) <= _LONGEST_ID and value.isprintable()
