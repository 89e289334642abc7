"""A small bundle and its folder, for tests of bundles and of commands."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isi.bundle import folder
from isi.bundle.manifest import MODEL, Bundle, Manifest, WordSource

NAMES = ["kitchen", "bedroom", "kettle", "bed", "turn on", "lie on"]
KINDS = ["room", "room", "object", "object", "affordance", "affordance"]
BETWEEN = ["atLocation", "hasAffordance"]
#: f(h, r, t) = Σ h · r · t: what is where, and what can be done with it, in coordinates of their own.
VECTORS = [[1, 0, 0, 0], [0, 1, 0, 0], [3, 1, 2, 0], [1, 2, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]]
RELATIONS = [[1, 1, 0, 0], [0, 0, 1, 1]]
TRIPLES = [(2, 0, 0), (3, 0, 1), (2, 1, 4), (3, 1, 5)]
#: Of unit length, but for the rooms, which have none.
WORDS = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.8, 0, 0.6], [0, 0.8, 0.6]]


def small(**changed: Any) -> Bundle:
    """Four triples about a kettle and a bed."""
    manifest = Manifest(
        model_name="distmult", model_options={}, words=WordSource(source="shipped", text="definition", model=MODEL),
        made={"by": "a test"}, inserted=[],
    )  # fmt: skip
    given: dict[str, Any] = {
        "manifest": manifest, "entities": np.array(VECTORS, np.float32), "relations": np.array(RELATIONS, np.float32),
        "entity_names": list(NAMES), "kinds": list(KINDS), "phrases": list(NAMES), "relation_names": list(BETWEEN),
        "triples": np.array(TRIPLES), "words": np.array(WORDS, np.float32),
    }  # fmt: skip
    return Bundle(**{**given, **changed})


def written(path: Path, bundle: Bundle | None = None) -> Path:
    """The folder of a bundle, the small one where none is given."""
    folder.write(path, bundle or small())
    return path


def without_words() -> Bundle:
    """The small bundle without word vectors."""
    bundle = small(words=None)
    return replace(bundle, manifest=bundle.manifest.model_copy(update={"words": None}))


def files(path: Path) -> dict[str, bytes]:
    """Bytes by name."""
    return {file.name: file.read_bytes() for file in path.iterdir()}


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the manifest of a folder."""
    manifest = json.loads((path / folder.MANIFEST).read_text(encoding="utf-8"))
    change(manifest)
    (path / folder.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")


def tamper(path: Path, name: str, content: bytes) -> None:
    """Put other bytes into a file, with their SHA-256."""
    (path / name).write_bytes(content)
    edit(path, lambda manifest: manifest["files"].update({name: hashlib.sha256(content).hexdigest()}))
