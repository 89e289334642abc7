"""Observations of a home's rooms and their objects, as robots log them:
``{"rooms": [{"name", "objects": [...]}]}``.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import AliasChoices, BeforeValidator, Field, create_model

from isi.sources import Mining, Observation, observed, once, reader
from isi.sources.names import Label, Naming, words
from isi.sources.readers import MOST, json_lines, parse_json


def _of(kind: Any, *keys: str, default: Any = ...) -> Any:
    """A field that the first of ``keys`` in the mapping gives."""
    return kind, Field(default, validation_alias=AliasChoices(*keys))


#: One name or a list of names; null is none.
_Names = Annotated[
    list[Label],
    BeforeValidator(
        lambda value: value if isinstance(value, list) else [value][: value is not None]
    ),
]
#: An object: its class goes before its name, which may be that of an instance, such as ``mug_3``.
_Object: Any = create_model(
    "Object",
    id=(Label | int | None, None),
    name=_of(Label, "class", "type", "label", "name"),
    **{
        f"{key}s": _of(_Names, key, f"{key}s", default=[])
        for key in ("receptacle", "material", "affordance")
    },
)
_Named = Annotated[
    _Object, BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value)
]
_Room: Any = create_model(
    "Room", name=_of(Label, "name", "type", "id"), objects=(list[_Named], ...)
)
_Home: Any = create_model("Home", rooms=(list[_Room], ...))


@reader("rooms", Naming(household=True), path="path")
def rooms(mining: Mining, path: str) -> Iterator[Observation]:
    """Observations of the rooms of a home (JSON), or of each line (JSON Lines):
    its state at a time.

    An object is a name, or a mapping with ``class`` or ``name`` and perhaps ``id``, ``receptacle``
    (a name, or the id of an object), ``material`` and ``affordance`` (each a name or a list). What
    several states have counts once.
    """
    lines = json_lines(Path(path), MOST, "a home's rooms")
    homes = (
        parse_json(_Home, content, path, f"line {number}" * (number > 1))
        for number, content in lines
    )
    return once((_observations(Path(path).stem, home) for home in homes), mining.counts)


def _observations(scene: str, home: Any) -> Iterator[Observation]:
    name_of = {
        str(thing.id): thing.name
        for room in home.rooms
        for thing in room.objects
        if thing.id is not None
    }
    for room in home.rooms:
        numbers = Counter[str]()
        for thing in room.objects:
            numbers[thing.name] += 1
            instance = (
                f"{room.name}, {thing.name} {numbers[thing.name]}"
                if thing.id is None
                else str(thing.id)
            )
            receptacles = [words(name_of.get(name, name)) for name in thing.receptacles]
            others = [*map(words, thing.materials)], [*map(words, thing.affordances)]
            yield from observed(
                scene, words(room.name), instance, words(thing.name), receptacles, *others
            )
