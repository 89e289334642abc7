"""Recorded scenes of AI2-THOR and RoboTHOR:
those of the package ``procthor``, and those of ``make record``.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, AliasChoices, BaseModel, Field, create_model

from isi import config
from isi.config import Count, EachOnce, Section, Seed
from isi.errors import InputError, cut, short
from isi.names import name_fault
from isi.sources.names import Label, entity_name
from isi.sources.readers import GZIP, json_lines, packaged, parse_json, reading
from isi.tables import paths
from isi.tables.io import check_sha256

#: Header of a recording of ``make record``: its first line, as JSON. Each line after it is a scene.
FORMAT = {"format": "isi recording", "version": 1, "simulator": "ai2thor"}
#: Maximum bytes of a line of a recording (a thousand times the largest scene), and of the package's
#: JSON file, which is read as a whole (three times its size).
MOST_BYTES, MOST_BYTES_WHOLE = 2**26, 2**27
#: Actions that an object affords, by its property.
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

#: Keys of AI2-THOR before version 4.0, by today's.
OLD_KEYS = {"isHeatSource": "canChangeTempToHot", "isColdSource": "canChangeTempToCold"}


def _flag(name: str) -> Any:
    """A field that is true, false or missing, by its key today or its old one."""
    return bool, Field(False, validation_alias=AliasChoices(name, OLD_KEYS.get(name, name)))


_Text = Annotated[str, Field(min_length=1)]
#: Fields of a reported object that mining reads: type, and default if the field may be missing.
_FIELDS: dict[str, Any] = {
    "objectId": (Label, ...),
    "objectType": (
        Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z]([A-Za-z0-9_ -]*[A-Za-z0-9_-])?$")],
        ...,
    ),
    **dict.fromkeys(
        ("parentReceptacles", "receptacleObjectIds"),
        (Annotated[list[Label], EachOnce] | None, None),
    ),
    "salientMaterials": (list[Label] | None, None),
    **{name: _flag(name) for name in AFFORDANCES},
}
FIELDS = tuple(_FIELDS)
_Reported: Any = create_model("Reported", **_FIELDS)
_Objects: Any = Annotated[list[_Reported], Field(max_length=100_000)]


class SceneObject(NamedTuple):
    """An object of a scene, with the fields that mining uses."""

    id: str
    name: str  #: lower-case words of its type
    receptacles: Sequence[str] = ()  #: ids of receptacles that it is on or in
    contents: Sequence[str] = ()  #: ids of the objects on or in it
    materials: Sequence[str] = ()
    affordances: Sequence[str] = ()


class Scene(NamedTuple):
    """A scene: its name, the number of its floor plan (the key of random streams), its room,
    and its objects.
    """

    name: str
    number: int
    room: str
    objects: list[SceneObject]


class FloorPlans(NamedTuple):
    """Floor plans of one kind of room."""

    key: str  #: of their list of scenes in the package's recording
    room: str
    first: int  #: number of the first floor plan
    names: Sequence[str]  #: names in the simulator
    packaged: Sequence[str] = ()  #: names in the package's recording, if its scenes have other ones


ITHOR = tuple(
    FloorPlans(key, room, first, [f"FloorPlan{number}" for number in range(first, first + 30)])
    for key, room, first in (
        ("kitchens", "kitchen", 1),
        ("living_rooms", "living room", 201),
        ("bedrooms", "bedroom", 301),
        ("bathrooms", "bathroom", 401),
    )
)
_APARTMENTS = [
    f"{part}{walls}"
    for part, number in (("Train", 12), ("Val", 3))
    for walls in range(1, number + 1)
]
_PLANS = [
    f"FloorPlan_{apartment}_{objects}" for apartment in _APARTMENTS for objects in range(1, 6)
]
#: Each floor plan is one apartment; a recording does not contain the rooms of its objects.
ROBOTHOR = (
    FloorPlans(
        "robothor", "apartment", 501, _PLANS, [f"RoboTHOR{place}" for place in range(1, 76)]
    ),
)
#: Floor plans by simulator, whose reader has the same name.
SIMULATORS = {"ai2thor": ITHOR, "robothor": ROBOTHOR}


class Layout(BaseModel):
    """A floor plan with its objects as built (``spawn`` null),
    or placed at random with the seed ``spawn``.
    """

    scene: _Text
    spawn: int | None
    objects: Any = None  #: in a recording only; ``scene_objects`` validates them

    @property
    def name(self) -> str:
        return self.scene if self.spawn is None else f"{self.scene}#{self.spawn}"


def locate(from_: str, simulator: str = "ai2thor") -> Path:
    """Path of a recording: ``recording`` (package ``procthor``), ``simulator`` (``make record``),
    else ``from_``.
    """
    if from_ == "simulator":
        return paths.DATA / "recordings" / f"{simulator}.jsonl.gz"
    if from_ != "recording":
        return Path(from_)
    return packaged(
        "procthor", "procthor/databases/ai2thor-object-metadata.json", "the recording of the scenes"
    )


def read_recording(
    path: Path, sha256: str | None, plans: Sequence[FloorPlans] = ITHOR
) -> Iterator[Scene]:
    """Scenes of a recording: lines of ``make record`` (gzip), or JSON as in ``procthor``,
    which needs all ``plans``.
    """
    if path.exists() and not path.is_file():
        raise InputError(path, "", "expected a file: a recording is not read from a pipe")
    check_sha256(path, sha256)
    with reading(path, "a recording of AI2-THOR's scenes"), path.open("rb") as file:
        is_compressed = file.read(len(GZIP)) == GZIP
    return _recorded_scenes(path, plans) if is_compressed else _packaged_scenes(path, plans)


def _packaged_scenes(path: Path, plans: Iterable[FloorPlans]) -> Iterator[Scene]:
    _, content = next(json_lines(path, MOST_BYTES_WHOLE, "JSON"), (1, b""))
    recording = parse_json(dict[str, Any], content, path)
    for plan in plans:
        names = plan.packaged or plan.names
        scenes = config.check(recording.get(plan.key), list[Any], plan.key, path)
        if len(scenes) != len(names):
            raise InputError(
                path, plan.key, f"expected a list of {len(names)} scenes, got {len(scenes)}"
            )
        for number, (name, objects) in enumerate(zip(names, scenes, strict=True), plan.first):
            yield Scene(name, number, plan.room, scene_objects(path, name, objects))


def _recorded_scenes(path: Path, plans: Iterable[FloorPlans]) -> Iterator[Scene]:
    known = {
        name: (number, plan.room)
        for plan in plans
        for number, name in enumerate(plan.names, plan.first)
    }
    lines = json_lines(
        path,
        MOST_BYTES,
        "a whole gzip file (`make record` resumes after the last whole scene)",
    )
    check_header(path, next(lines, (1, b""))[1])
    seen: set[str] = set()
    for number, line in lines:
        recorded = parse_json(Layout, line, path, f"line {number}")
        name, plan = recorded.name, recorded.scene
        fault = name_fault(name) or f"scene {name} is in the file twice" * (name in seen)
        if plan not in known:
            fault = (
                f"expected a floor plan of this source, such as {next(iter(known))}, "
                f"got {short(plan)}"
            )
        if fault:
            raise InputError(path, f"line {number}", fault)
        seen.add(name)
        yield Scene(name, *known[plan], scene_objects(path, name, recorded.objects))
    if not seen:
        raise InputError(path, "", "expected scenes after the header, got none")


def absent_properties(objects: Iterable[Mapping[str, Any]]) -> list[str]:
    """The keys of ``AFFORDANCES`` that none of the reported objects has."""
    present = set().union(*objects)
    return [name for name in AFFORDANCES if {name, OLD_KEYS.get(name, name)}.isdisjoint(present)]


def scene_objects(path: Path, scene: str, reported: Any) -> list[SceneObject]:
    """Validate the reported objects of a scene; InputError for a wrong field or a repeated id."""
    objects: dict[str, SceneObject] = {}
    for thing in config.check(reported, _Objects, scene, path):
        if thing.objectId in objects:
            raise InputError(
                path, f"{scene}, object {cut(thing.objectId)}", "is in the scene twice"
            )
        objects[thing.objectId] = SceneObject(
            thing.objectId,
            entity_name(thing.objectType),
            thing.parentReceptacles or [],
            thing.receptacleObjectIds or [],
            list(dict.fromkeys(map(str.lower, thing.salientMaterials or ()))),
            [
                action
                for key, actions in AFFORDANCES.items()
                if getattr(thing, key)
                for action in actions
            ],
        )
    return list(objects.values())


def check_header(path: Path, line: bytes, expected: Mapping[str, Any] = FORMAT) -> None:
    """InputError unless the first line of a recording is a JSON object with
    all items of ``expected``.
    """
    header = parse_json(dict[str, Any], line, path, "line 1")
    if differs := next((key for key, value in expected.items() if header.get(key) != value), None):
        got = (
            f"{short(expected[differs])} as {differs} of the recording, "
            f"got {short(header.get(differs))}"
        )
        raise InputError(path, "line 1", f"expected {got}")


#: Builds that the package ``ai2thor`` downloads.
PLATFORMS = ("CloudRendering", "Linux64", "OSXIntel64")
#: Names of groups of floor plans.
GROUPS = {"ithor": [name for plans in ITHOR for name in plans.names], "robothor": _PLANS}


def _floor_plans(items: list[str]) -> list[str]:
    """Floor plans from names of groups, names of floor plans,
    and ranges such as ``FloorPlan201-230``.
    """
    plans = []
    for item in items:
        parts = re.fullmatch(r"([A-Za-z]\w{0,98}?)([0-9]{1,6})(?:-([0-9]{1,6}))?", item, re.ASCII)
        numbers = range(int(parts[2]), int(parts[3] or parts[2]) + 1) if parts else ()
        of_item = GROUPS.get(item) or [f"{parts[1]}{number}" for number in numbers if parts]
        if not of_item:
            expected = (
                f"expected {', '.join(GROUPS)}, a floor plan or a range such as FloorPlan1-30"
            )
            raise ValueError(f"{expected}, got {item[:80]!r}")
        plans += of_item
    return plans


class Recorder(Section):
    """Settings of ``make record``: the section ``recorder`` of params."""

    #: floor plans
    scenes: Annotated[list[str], Field(min_length=1), AfterValidator(_floor_plans), EachOnce]
    #: layouts of each floor plan: null (as built), or the seed of ``InitialRandomSpawn``
    spawns: Annotated[list[Seed | None], Field(min_length=1), EachOnce]
    output: _Text
    platform: _Text  #: one of ``PLATFORMS``, or the path of a local build
    #: commit of the build to download; null: the package's own
    build: Annotated[str, Field(pattern=r"^[0-9a-f]{40}$")] | None
    width: Count  #: width and height of a frame (pixels)

    @property
    def layouts(self) -> list[Layout]:
        """All layouts to record, in order."""
        return [Layout(scene=plan, spawn=spawn) for plan in self.scenes for spawn in self.spawns]

    @property
    def executable(self) -> Path | None:
        """The path of a local build; None if a build is downloaded."""
        return None if self.platform in PLATFORMS else Path(self.platform)
