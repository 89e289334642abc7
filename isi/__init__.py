"""Incremental semantic initialization (ISI) of entities in knowledge-graph embeddings.

``open`` gives the live embedding of a folder, to which a robot adds entities and facts, and which
answers; ``of`` makes one of a PyKEEN model, ``train`` of triples. ``insert`` adds new entities to
arrays; ``fit_new`` trains their rows; ``isi.pykeen`` is for PyKEEN models.
They are imported on first use (types are in ``__init__.pyi``).
"""

import importlib
from typing import Any

__all__ = ["InputError", "LiveEmbedding", "fit_new", "insert", "of", "open", "train"]

#: Module and name there of each name here.
_WHERE = {
    "InputError": ("isi.errors", "InputError"),
    "LiveEmbedding": ("isi.bundle.live", "LiveEmbedding"),
    "fit_new": ("isi.insertion.fit", "fit_new"),
    "insert": ("isi.insertion.api", "insert"),
    "of": ("isi.pykeen.live", "of"),
    "open": ("isi.bundle.live", "open_live"),
    "train": ("isi.bundle.train", "train"),
}


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE, "pykeen"])


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        module, there = _WHERE[name]
        return getattr(importlib.import_module(module), there)
    if name == "pykeen":
        return importlib.import_module("isi.pykeen")
    raise AttributeError(f"module 'isi' has no attribute {name!r}")
