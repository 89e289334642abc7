"""Mistakes in command lines about embeddings
(``isi insert``, ``observe``, ``remove``, ``undo``, ``ask``, ...).
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors.numpy import save

import isi
from tests.mistakes.calls import Typed
from tests.small_bundle import NAMES, edit, small, tamper, written

LARGEST = "x" * 300


def large() -> None:
    """Write the embedding with vectors so large that a score overflows."""
    tensors = {"entities": small().entities * np.float32(1e30), "relations": small().relations}
    tamper(Path("home"), "vectors.safetensors", bytes(save(tensors)))


def distances() -> None:
    """Write an embedding whose scoring function is a distance."""
    options = {"margin": 1.0, "squared": False}
    manifest = small().manifest.model_copy(
        update={"model_name": "transe", "model_options": options}
    )
    written(Path("home"), small(manifest=manifest))


def twins() -> None:
    written(Path("home"), small(entity_names=[*NAMES[:-1], "turnOn"]))


def inserted(why: str, folder: str = "home", entity: str = NAMES[-1]) -> Callable[[], object]:
    """A function that marks an entity (default: the last) of an embedding as inserted."""
    one = {
        "entity": entity,
        "told": [["bed", "hasAffordance", entity]],
        "definition": None,
        "asked": None,
        "options": {},
        "seed": 0,
        "initializer": "mean",
        "why": why,
        "fallback": None,
    }
    return lambda: edit(Path(folder), lambda about: about.update(inserted=[one]))


def inserted_elsewhere() -> None:
    """Insert an entity in another folder."""
    live = isi.open(written(Path("other")))
    live.insert("hob", [("hob", "atLocation", "kitchen")])
    live.save()


def changed() -> None:
    """Insert an entity, and give a fact of a known one."""
    live = isi.open("home")
    live.insert("hob", [("hob", "atLocation", "kitchen")])
    live.observe([("kettle", "atLocation", "bedroom")])
    live.save()


COMMAND_CASES = [
    Typed("a long name", f"insert {'x' * 1001} --fact atLocation bed --embedding home", "name"),
    Typed(
        "a long name of the output",
        f"insert x --fact atLocation bed --out {LARGEST} --embedding home",
        "xxx...xxx",
    ),
    Typed("a name of a folder that is too long", f"nearest bed --embedding {LARGEST}", "xxx...xxx"),
    Typed(
        "what moves a terminal's cursor, in what the folder says of it",
        "explain 'lie on' --embedding home",
        "home/embedding.json|inserted.0.why",
        before=inserted("\x1b[2J"),
    ),
]
