"""BEHAVIOR-1K's scenes: which kinds of objects stand in which rooms, and what can be done with them."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field

from isi.errors import InputError, short
from isi.sources import Mining, Observation, observed, reader
from isi.sources.names import Name, household, name_fault
from isi.sources.readers import check_settings, packaged, read_json, read_table, refuse

SCENES, CATEGORIES = "combined_room_object_list.json", "category_mapping.csv"
PROPERTIES = "propagated_annots_canonical.json"
STEPS = ("instances", "without structure")  #: After each step of mining, what is left is counted.
SYNSET = re.compile(r"([^\s.]{1,60})\.[nvars]\.[0-9]{2}")
#: The number of objects of each model in a room; the name of a model is a category and six letters.
_Model = Annotated[str, Field(pattern=r"^[\w-]{1,60}-[a-z]{6}$")]
_Models = dict[_Model, Annotated[int, Field(ge=1, le=1_000_000)]]
#: Models by room, whose name is its type and a number; and rooms by scene.
_Rooms = dict[Annotated[str, Field(pattern=r"^[a-z_]{1,60}_[0-9]{1,6}$")], Annotated[_Models, Field(min_length=1)]]
_Scenes = dict[Annotated[str, Field(pattern=r"^\w{1,100}$")], Annotated[_Rooms, Field(min_length=1)]]


class _SceneList(BaseModel):
    scenes: Annotated[_Scenes, Field(min_length=1)]


@reader("behavior", household, path="from_")
def behavior(
    mining: Mining, from_: str, structure: list[str], names: dict[str, Name], affordances: dict[str, list[Name]]
) -> Iterator[Observation]:
    """Observations of the scenes. An object has the name of its synset; there are no materials.

    ``from_`` is ``package``, the data in the package ``bddl``, or the path of a folder of the same files; ``structure``
    are synsets of parts of the building, which are left out; ``names`` renames synsets and types of rooms;
    ``affordances`` lists the affordances of an object with a property.
    """
    content = "the scenes of BEHAVIOR-1K"
    folder = packaged("bddl", "bddl/generated_data", content) if from_ == "package" else Path(from_)
    path, categories, listed = (folder / name for name in (SCENES, CATEGORIES, PROPERTIES))
    scenes = read_json(_SceneList, path, content).scenes
    properties = read_json(dict[str, dict[str, Any]], listed, content)
    table = read_table(categories, ["category", "synset"]).drop_duplicates(["category", "synset"])
    refuse(categories, table["category"], table.duplicated("category"), "expected each category with one synset")
    synset_of = dict(zip(table["category"], table["synset"], strict=True))
    check_settings(categories, "synset", structure, synset_of.values())
    check_settings(listed, "property", affordances, {name for of_synset in properties.values() for name in of_synset})
    synset_named: dict[str, str] = {}
    for scene, room, model, count in (
        (scene, room, model, count)
        for scene, rooms in scenes.items()
        for room, models in rooms.items()
        for model, count in models.items()
    ):
        synset = synset_of.get(model[:-7], "")
        if not SYNSET.fullmatch(synset) or synset not in properties:
            expected = f"expected a category listed in {CATEGORIES}, whose synset {PROPERTIES} lists"
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
        if synset_named.setdefault(head, synset) != synset:
            expected = f"{synset_named[head]} has this name, too: give {synset} another one in the setting names"
            raise InputError(categories, f"entity {head!r}", expected)
        actions = {action for name in properties[synset] for action in affordances.get(name, ())}
        yield from observed(scene, place, f"{room}/{model}", head, affordances=sorted(actions), count=count)


def _words(key: str) -> str:
    return " ".join(key.lower().replace("_", " ").split())
