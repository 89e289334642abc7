"""Broken folders of bundles, and the message of every command that reads one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save

from tests.mistakes.calls import Typed
from tests.small_bundle import edit, small, tamper

HOME = Path("home")
INSERTED = {
    "entity": "lie on",
    "told": [("bed", "hasAffordance", "lie on")],
    "definition": "to rest",
    "asked": None,
    "options": {"k": 2},
    "seed": 3,
    "initializer": "rs",
    "why": "the best",
    "fallback": None,
}
NAN = small().entities.copy()
NAN[3, 1] = np.nan


def tensors(**changed: Any) -> bytes:
    given = {"entities": small().entities, "relations": small().relations, **changed}
    return bytes(save({name: value for name, value in given.items() if value is not None}))


def put(name: str, content: bytes) -> Callable[[], object]:
    """A function that replaces the bytes of a file, and its digest in the manifest."""
    return lambda: tamper(HOME, name, content)


def vectors(**changed: Any) -> Callable[[], object]:
    return put("vectors.safetensors", tensors(**changed))


def manifest(**changed: Any) -> Callable[[], object]:
    """A function that changes values in the manifest."""
    return lambda: edit(HOME, lambda values: values.update(changed))


def content(text: bytes) -> Callable[[], object]:
    """A function that replaces the text of the manifest."""
    return lambda: (HOME / "embedding.json").write_bytes(text)


def changed() -> None:
    """Change a file, but not its digest."""
    file = HOME / "entities.tsv"
    file.write_bytes(file.read_bytes().replace(b"object", b"gadget"))


#: Texts of the message, and the function that breaks the folder.
BROKEN: list[tuple[str, Callable[[], object]]] = [
    ("triples.tsv", (HOME / "triples.tsv").unlink),
    ("entities.tsv", changed),
    *(("embedding.json", content(text)) for text in (b"{", b"[" * 10**6, b"[]")),
    ("embedding.json|version", manifest(version=2)),
    ("embedding.json|pickle", manifest(pickle="x")),
    ("embedding.json|family", lambda: edit(HOME, lambda values: values.pop("family"))),
    ("embedding.json|family", manifest(family="holographic")),
    ("embedding.json|family|margin", manifest(family="transe")),
    ("embedding.json|family", manifest(family_options={"margin": 2.0})),
    (
        "vectors.safetensors|relations",
        manifest(family="rotate", family_options={"margin": 1.0, "squared": False}),
    ),
    ("embedding.json|entities", manifest(entities=7)),
    ("embedding.json|inserted", manifest(inserted=[{**INSERTED, "entity": "bed"}])),
    (
        "embedding.json|inserted.0.told",
        manifest(inserted=[{**INSERTED, "told": [["sofa", "hasAffordance", "lie on"]]}]),
    ),
    ("embedding.json|triples", put("triples.tsv", b"head\trelation\ttail\n")),
    ("vectors.safetensors", put("vectors.safetensors", b"x" * 50)),
    ("vectors.safetensors", put("vectors.safetensors", tensors()[:-40])),
    ("vectors.safetensors|tensor 'relations'", vectors(relations=None)),
    ("vectors.safetensors|tensor 'code'", vectors(code=np.ones((2, 2)))),
    ("vectors.safetensors|tensor 'entities'", vectors(entities=NAN)),
    ("vectors.safetensors|tensor 'words'", vectors(words=np.ones((6, 2), np.int64))),
    ("vectors.safetensors|relations", vectors(relations=small().relations[:, :3])),
    (
        "vectors.safetensors|tensor 'relations'",
        put("relations.tsv", b"relation\natLocation\nhasAffordance\nz\n"),
    ),
    ("relations.tsv|line 1", put("relations.tsv", b"name\natLocation\n")),
    ("relations.tsv|line 2", put("relations.tsv", b"relation\n \nx\n")),
    *(
        ("relations.tsv|line 3", put("relations.tsv", b"relation\nx\n" + row))
        for row in (b"x\ty\n", b"x\n", b"\x1b\n")
    ),
    ("relations.tsv|UTF-8", put("relations.tsv", b"relation\nat\nh\xff\n")),
    ("triples.tsv|line 2", put("triples.tsv", b"head\trelation\ttail\nbed\tatLocation\tsofa\n")),
]
FOLDER_CASES = [
    Typed(f"a broken {names}", "nearest bed --embedding home", f"/{names}", before=before)
    for names, before in BROKEN
]
