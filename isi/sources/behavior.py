"""Observations of BEHAVIOR-1K's scenes: the rooms and the affordances of objects."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field

from isi.errors import InputError, short
from isi.names import name_fault
from isi.sources import Mining, Observation, observed, reader
from isi.sources.names import Label, household
from isi.sources.readers import check_settings, packaged, read_json, read_table, refuse

SCENES, CATEGORIES = "combined_room_object_list.json", "category_mapping.csv"
PROPERTIES = "propagated_annots_canonical.json"
#: Descriptions of counts: the instances that remain after each step.
STEPS = ("instances", "without structure")
SYNSET = re.compile(r"([^\s.]{1,60})\.[nvars]\.[0-9]{2}")
#: Number of objects in a room by name of their 3D model: category, hyphen and six letters.
_Model = Annotated[str, Field(pattern=r"^[\w-]{1,60}-[a-z]{6}$")]
_Models = dict[_Model, Annotated[int, Field(ge=1, le=1_000_000)]]
#: Models by name of a room (type, underscore and number); rooms by scene.
_Rooms = dict[
    Annotated[str, Field(pattern=r"^[a-z_]{1,60}_[0-9]{1,6}$")],
    Annotated[_Models, Field(min_length=1)],
]
_Scenes = dict[
    Annotated[str, Field(pattern=r"^\w{1,100}$")], Annotated[_Rooms, Field(min_length=1)]
]


class _SceneList(BaseModel):
    scenes: Annotated[_Scenes, Field(min_length=1)]


@reader("behavior", household, path="from_")
def behavior(
    mining: Mining,
    from_: str,
    structure: list[str],
    names: dict[str, Label],
    affordances: dict[str, list[Label]],
) -> Iterator[Observation]:
    """Observations of the scenes, without materials.
    The name of an object is the word of its synset.

    ``from_`` is ``package`` (the data in the package ``bddl``) or a folder with the same files.
    ``structure`` lists synsets to omit: parts of the building. ``names`` maps synsets and types of
    rooms to other names. ``affordances`` lists the affordances that each property of a synset
    implies.
    """
    content = "the scenes of BEHAVIOR-1K"
    folder = packaged("bddl", "bddl/generated_data", content) if from_ == "package" else Path(from_)
    path, categories, of_properties = (folder / name for name in (SCENES, CATEGORIES, PROPERTIES))
    scenes = read_json(_SceneList, path, content).scenes
    properties = read_json(dict[str, dict[str, Any]], of_properties, content)
    synset_of = _synsets(categories)
    check_settings(categories, "synset", structure, synset_of.values())
    known_properties = {name for of_synset in properties.values() for name in of_synset}
    check_settings(of_properties, "property", affordances, known_properties)
    room_types = {room.rpartition("_")[0] for rooms in scenes.values() for room in rooms}
    check_settings(path, "synset or type of room", names, {*synset_of.values(), *room_types})
    synset_named: dict[str, str] = {}
    for scene, room, model, count in _objects(scenes):
        synset = synset_of.get(model[:-7], "")
        if not SYNSET.fullmatch(synset) or synset not in properties:
            expected = f"expected a category in {CATEGORIES} with a synset in {PROPERTIES}"
            raise InputError(path, f"{scene}: {room}: model {short(model)}", expected)
        mining.counts[STEPS[0]] += count
        if synset in structure:
            continue
        mining.counts[STEPS[1]] += count
        room_type = room.rpartition("_")[0]
        head = names.get(synset) or _words(synset.partition(".")[0])
        place = names.get(room_type) or _words(room_type)
        if fault := name_fault(head) or name_fault(place):
            raise InputError(path, f"{scene}: {room}: {short(synset)}", fault)
        if (other := synset_named.setdefault(head, synset)) != synset:
            remedy = f"give {synset} another name in the setting names"
            raise InputError(
                categories, f"entity {head!r}", f"{other} has this name, too: {remedy}"
            )
        actions = {action for name in properties[synset] for action in affordances.get(name, ())}
        yield from observed(
            scene, place, f"{room}/{model}", head, affordances=sorted(actions), count=count
        )


def _synsets(categories: Path) -> dict[str, str]:
    """The synset of each category; ``InputError`` if a category has two."""
    columns = ["category", "synset"]
    table = read_table(categories, columns).drop_duplicates(columns)
    expected = "expected each category with one synset"
    refuse(categories, table["category"], table.duplicated("category"), expected)
    return dict(zip(table["category"], table["synset"], strict=True))


def _objects(
    scenes: Mapping[str, Mapping[str, Mapping[str, int]]],
) -> Iterator[tuple[str, str, str, int]]:
    """Scene, room, model and number of each kind of object."""
    for scene, rooms in scenes.items():
        for room, models in rooms.items():
            for model, count in models.items():
                yield scene, room, model, count


def _words(key: str) -> str:
    return " ".join(key.lower().replace("_", " ").split())
