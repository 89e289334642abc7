"""Incremental semantic initialization (ISI) of entities in knowledge-graph embeddings.

``insert`` adds new entities to a trained embedding; ``fit_new`` trains their rows; ``isi.pykeen`` is for PyKEEN models.
They are imported on first use (types are in ``__init__.pyi``).
"""

import importlib
from typing import Any

__all__ = ["InputError", "fit_new", "insert"]

_WHERE = {"InputError": "isi.errors", "fit_new": "isi.insertion.fit", "insert": "isi.insertion.api"}


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE, "pykeen"])


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    if name == "pykeen":
        return importlib.import_module("isi.pykeen")
    raise AttributeError(f"module 'isi' has no attribute {name!r}")
