"""Folders of embeddings that are broken: what every command says that reads one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save

from tests.mistakes.calls import Typed
from tests.small_bundle import edit, small, tamper

HOME = Path("home")
NEAREST = "nearest bed --embedding home"
TOLD = {
    "entity": "lie on", "told": [("bed", "hasAffordance", "lie on")], "definition": "to rest", "asked": None,
    "options": {"k": 2}, "seed": 3, "initializer": "rs", "why": "the best", "fallback": None,
}  # fmt: skip
NAN = small().entities.copy()
NAN[3, 1] = np.nan


def tensors(**changed: Any) -> bytes:
    kept = small()
    given = {"entities": kept.entities, "relations": kept.relations, **changed}
    return bytes(save({name: value for name, value in given.items() if value is not None}))


def put(name: str, content: bytes) -> Callable[[], object]:
    """Other bytes in a file, with their digest."""
    return lambda: tamper(HOME, name, content)


def vectors(**changed: Any) -> Callable[[], object]:
    return put("vectors.safetensors", tensors(**changed))


def says(**changed: Any) -> Callable[[], object]:
    """The folder says something else of itself."""
    return lambda: edit(HOME, lambda about: about.update(changed))


def about(content: bytes) -> Callable[[], object]:
    return lambda: (HOME / "embedding.json").write_bytes(content)


def changed() -> None:
    """A file without a new digest."""
    file = HOME / "entities.tsv"
    file.write_bytes(file.read_bytes().replace(b"object", b"gadget"))


FOLDER_CASES = [
    Typed("a file that is missing", NEAREST, "/triples.tsv", before=lambda: (HOME / "triples.tsv").unlink()),
    Typed("no JSON", NEAREST, "/embedding.json", before=about(b"{")),
    Typed("JSON, a million deep", NEAREST, "/embedding.json", before=about(b"[" * 10**6)),
    Typed("JSON of something else", NEAREST, "/embedding.json", before=about(b"[]")),
    Typed("a later version", NEAREST, "/embedding.json|version", before=says(version=2)),
    Typed("a key too many", NEAREST, "/embedding.json|pickle", before=says(pickle="x")),
    Typed("a key that is missing", NEAREST, "/embedding.json|family", before=lambda: edit(HOME,
          lambda about: about.pop("family"))),
    Typed("another number of entities than there are", NEAREST, "/embedding.json|entities",
          before=says(entities=7)),
    Typed("an option that its family does not have", NEAREST, "/embedding.json|family",
          before=says(family_options={"margin": 2.0})),
    Typed("inserted entities that are not the last", NEAREST, "/embedding.json|inserted",
          before=says(inserted=[{**TOLD, "entity": "bed"}])),
    Typed("told of an entity that is not there", NEAREST, "/embedding.json|inserted.0.told",
          before=says(inserted=[{**TOLD, "told": [["sofa", "hasAffordance", "lie on"]]}])),
    Typed("no tensors", NEAREST, "/vectors.safetensors", before=put("vectors.safetensors", b"x" * 50)),
    Typed("half of the tensors", NEAREST, "/vectors.safetensors", before=put("vectors.safetensors", tensors()[:-40])),
    Typed("a tensor that is missing", NEAREST, "/vectors.safetensors|tensor 'relations'",
          before=vectors(relations=None)),
    Typed("a tensor too many", NEAREST, "/vectors.safetensors|tensor 'code'", before=vectors(code=np.ones((2, 2)))),
    Typed("NaN", NEAREST, "/vectors.safetensors|tensor 'entities'", before=vectors(entities=NAN)),
    Typed("word vectors of whole numbers", NEAREST, "/vectors.safetensors|tensor 'words'",
          before=vectors(words=np.ones((6, 2), np.int64))),
    Typed("relations of another width than the family has", NEAREST, "/vectors.safetensors|relations",
          before=vectors(relations=small().relations[:, :3])),
    Typed("another header", NEAREST, "/relations.tsv|line 1", before=put("relations.tsv", b"name\natLocation\n")),
    Typed("a cell too many", NEAREST, "/relations.tsv|line 3", before=put("relations.tsv",
          b"relation\natLocation\nx\ty\n")),
    Typed("another encoding", NEAREST, "/relations.tsv|UTF-8", before=put("relations.tsv", b"relation\nat\nh\xff\n")),
    Typed("a blank name", NEAREST, "/relations.tsv|line 2", before=put("relations.tsv", b"relation\n \nx\n")),
    Typed("a name twice", NEAREST, "/relations.tsv|line 3", before=put("relations.tsv", b"relation\nx\nx\n")),
    Typed("a control character in a name", NEAREST, "/relations.tsv|line 3", before=put("relations.tsv",
          b"relation\nx\n\x1b\n")),
    Typed("a name too many", NEAREST, "/vectors.safetensors|tensor 'relations'", before=put("relations.tsv",
          b"relation\natLocation\nhasAffordance\nz\n")),
    Typed("a triple of an entity that is not there", NEAREST, "/triples.tsv|line 2", before=put("triples.tsv",
          b"head\trelation\ttail\nbed\tatLocation\tsofa\n")),
    Typed("a triple too few", NEAREST, "/embedding.json|triples", before=put("triples.tsv", b"head\trelation\ttail\n")),
    Typed("a file that was changed", NEAREST, "/entities.tsv", before=changed),
]  # fmt: skip
