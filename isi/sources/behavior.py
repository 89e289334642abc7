"""BEHAVIOR-1K's scenes: which kinds of objects stand in which rooms, and what can be done with them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import pyarrow as pa
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from isi.errors import InputError, short
from isi.sources import Mining, part, source
from isi.sources._files import packaged
from isi.sources._household import AT_LOCATION, HAS_AFFORDANCE, household
from isi.sources._naming import fault
from isi.sources._rows import read_listed, read_text

SCENES, CATEGORIES, PROPERTIES = (
    "combined_room_object_list.json", "category_mapping.csv", "propagated_annots_canonical.json"
)  # fmt: skip
#: What is left after each step of mining.
STEPS = ("instances", "without structure")
ROOM = re.compile(r"([a-z_]{1,60})_[0-9]{1,6}")
MODEL = re.compile(r"([\w-]{1,60})-[a-z]{6}")
SYNSET = re.compile(r"([^\s.]{1,60})\.[nvars]\.[0-9]{2}")
#: How many objects of a model stand in a room.
Standing = Annotated[dict[str, Annotated[int, Field(ge=1, le=1_000_000)]], Field(min_length=1)]
Rooms = Annotated[dict[str, Standing], Field(min_length=1)]
T = TypeVar("T")


class Scenes(BaseModel):
    """What is read of the list of scenes: by scene, room and model."""

    scenes: Annotated[dict[str, Rooms], Field(min_length=1)]


@dataclass(frozen=True)
class Objects:
    """What is told of the objects that scenes are made of."""

    #: of each category
    synset: Mapping[str, str]
    #: of each synset
    properties: Mapping[str, Mapping[str, Any]]


@source("behavior", entities=household)
def behavior(
    mining: Mining, from_: str, structure: list[str], names: dict[str, str], affordances: dict[str, list[str]]
) -> Iterator[pa.Table]:
    """Observations of the scenes: objects go by the words of their synset; of what they are made is not told.

    Args:
        mining: counts what is left after each step.
        from_: ``package``, the data in the package ``bddl``, or the path of a folder of the same files.
        structure: synsets that are parts of the building, left out.
        names: of the synsets and types of rooms that do not go by their own words.
        affordances: what can be done with an object that has a property; other properties are left out.
    """
    folder = locate(from_)
    scenes, objects = read_scenes(folder / SCENES), read_objects(folder)
    _check_known(folder / CATEGORIES, "synset", structure, set(objects.synset.values()))
    for action in (action for actions in affordances.values() for action in actions):
        if wrong := fault(action):
            raise InputError("affordances", "", wrong)
    told = {name for properties in objects.properties.values() for name in properties}
    _check_known(folder / PROPERTIES, "property", affordances, told)
    seen: dict[str, str] = {}
    for scene, rooms in scenes.items():
        rows: list[tuple[str | int, ...]] = []
        for room, model, count in _standing(folder / SCENES, scene, rooms):
            synset = _synset(folder / SCENES, f"{scene}: {room}", model, objects)
            mining.left[STEPS[0]] += count
            if synset in structure:
                continue
            mining.left[STEPS[1]] += count
            head, place = _named(synset, SYNSET, names), _named(room, ROOM, names)
            for key, name in ((synset, head), (room, place)):
                if wrong := fault(name):
                    raise InputError(folder / SCENES, f"{scene}: {room}: {short(key)}", wrong)
            if seen.setdefault(head, synset) != synset:
                both = f"expected another name for {synset} in the setting names: {seen[head]} is called so, too"
                raise InputError(folder / CATEGORIES, f"entity {head!r}", both)
            actions = {action for name in objects.properties[synset] for action in affordances.get(name, ())}
            told_of = [(AT_LOCATION, place), *((HAS_AFFORDANCE, action) for action in sorted(actions))]
            rows += [(scene, place, f"{room}/{model}", head, relation, tail, count) for relation, tail in told_of]
        yield part(rows)


def locate(from_: str) -> Path:
    """The folder of the data: that in the package ``bddl`` (never imported), or as given."""
    if from_ != "package":
        return Path(from_)
    return packaged("bddl", "bddl/generated_data", "the scenes of BEHAVIOR-1K")


def read_scenes(path: Path) -> dict[str, Rooms]:
    """How many objects of each model stand in each room of each scene.

    Raises:
        InputError: where the file is missing, no JSON, or of another form.
    """
    return _read_json(path, Scenes).scenes


def read_objects(folder: Path) -> Objects:
    """Synsets of categories, and their properties.

    Raises:
        InputError: where a file is missing or broken, or lists a category under two synsets.
    """
    synsets: dict[str, str] = {}
    listed = read_listed(folder / CATEGORIES, ["category", "synset"])
    for line, category, synset in listed.itertuples(name=None):
        if synsets.setdefault(category, synset) != synset:
            raise InputError(folder / CATEGORIES, f"line {line}", f"{short(category)} is listed twice")
    return Objects(synsets, _read_json(folder / PROPERTIES, dict[str, dict[str, Any]]))


def _read_json(path: Path, form: type[T]) -> T:
    try:
        return TypeAdapter(form).validate_json(read_text(path, "a file of BEHAVIOR-1K"), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(path, ": ".join(short(place) for place in first["loc"]), first["msg"]) from error


def _standing(path: Path, scene: str, rooms: Mapping[str, Standing]) -> Iterator[tuple[str, str, int]]:
    """Rooms, the models in them, and how many of each; ``path`` is where that stands."""
    if not re.fullmatch(r"\w{1,100}", scene):
        raise InputError(path, f"scene {short(scene)}", "expected letters, digits and _")
    for room, models in rooms.items():
        if not ROOM.fullmatch(room):
            raise InputError(path, f"{scene}: room {short(room)}", "expected a type, _ and a number")
        for model, count in models.items():
            yield room, model, count


def _synset(path: Path, place: str, model: str, objects: Objects) -> str:
    """Of the category of a model."""
    found = MODEL.fullmatch(model)
    if not found:
        raise InputError(path, f"{place}: model {short(model)}", "expected a category, - and six letters")
    synset = objects.synset.get(found[1], "")
    if not SYNSET.fullmatch(synset) or synset not in objects.properties:
        expected = f"expected its category in {CATEGORIES}, with a synset that {PROPERTIES} has"
        raise InputError(path, f"{place}: model {short(model)}", expected)
    return synset


def _named(key: str, pattern: re.Pattern[str], names: Mapping[str, str]) -> str:
    """The name of a synset or a room: the words that it starts with, or another one."""
    found = pattern.fullmatch(key)
    own = found[1] if found else key
    return names.get(own if pattern is ROOM else key) or " ".join(own.lower().replace("_", " ").split())


def _check_known(path: Path, what: str, named: Mapping[str, Any] | list[str], known: set[str]) -> None:
    unknown = set(named) - known
    if unknown:
        raise InputError(path, f"{what} {min(unknown)!r}", "named in a setting, but not here")
