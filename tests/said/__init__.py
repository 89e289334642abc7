"""What a reader says of a file that is not what it reads: every cause, with the line that a user meets."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass, field
from typing import Any

from isi.sources._recording import FORMAT
from tests import floors
from tests.fuzz import formats
from tests.fuzz.formats import ENTITIES, THINGS
from tests.fuzz.mutations import Files

MUG, SHELF, FORK, FLOOR = THINGS
LOG = "head,relation,tail\nmug,atLocation,kitchen\n"
LONG = "x" * 10_000
#: As a message quotes it.
QUOTED = f"'{'x' * 27}...{'x' * 28}'"
NO_UTF8 = "'utf-8' codec can't decode byte 0xff in position 0: invalid start byte"
NOT_A_NAME = "expected a name without control characters, space around it or '../', got"


@dataclass(frozen=True)
class Case:
    """A mistake in a file."""

    what: str
    #: whose files are changed (``tests.fuzz.formats``)
    format: str
    #: what stands in their place; null: no such file
    files: dict[str, str | bytes | None]
    #: the line, behind the name of the command
    said: str
    #: of the section of params
    settings: dict[str, Any] = field(default_factory=dict)


def scene(*things: object, **of_the_mug: object) -> str:
    """A scene of these objects; else of the usual ones, the mug changed."""
    return json.dumps(list(things) or [MUG | of_the_mug, SHELF, FORK, FLOOR])


def recording(*lines: object, header: object = FORMAT) -> bytes:
    """A recording of ``make record``; text stands as it is."""
    return gzip.compress(
        "\n".join(one if isinstance(one, str) else json.dumps(one) for one in (header, *lines)).encode()
    )


def spawned(plan: str = "FloorPlan1", spawn: object = None, objects: object = THINGS) -> dict[str, object]:
    return {"scene": plan, "spawn": spawn, "objects": objects}


def house(*objects: object, **others: object) -> str:
    return json.dumps(floors.house(*objects, **others))


def mug(what: str, said: str, **change: object) -> Case:
    """A mistake in an object of a scene."""
    return Case(what, "scene", {"scene.json": scene(**change)}, f"scene.json: scene, object {MUG['objectId']}: {said}")


def log(what: str, rows: str, said: str, **settings: object) -> Case:
    """A mistake in a table of triples."""
    return Case(what, "table, CSV", {"log.csv": rows}, f"log.csv: {said}", {"entities": None, **settings})


def entities(what: str, row: str, said: str) -> Case:
    """A mistake in a table of entities."""
    return Case(what, "table, CSV", {"entities.csv": ENTITIES + row}, said)


def changed(what: str, form: str, file: str, old: str, new: str, said: str, **settings: object) -> Case:
    """A mistake in text."""
    text = formats.FORMATS[form].files[file].decode()
    assert old in text
    return Case(what, form, {file: text.replace(old, new, 1)}, said, settings)


def vectors(what: str, content: bytes, said: str, binary: bool = False) -> Case:
    """A mistake in a file of word vectors."""
    name = "words.bin" if binary else "words.txt"
    return Case(what, f"words{', binary' * binary}", {name: content}, f"{name}: {said}")


def files_of(case: Case) -> Files:
    """The files of a case."""
    files: Files = dict(formats.FORMATS[case.format].files)
    for name, content in case.files.items():
        files.pop(name, None)
        if content is not None:
            files[name] = content if isinstance(content, bytes) else content.encode("utf-8", "surrogateescape")
    return files
