"""Incremental semantic initialization (ISI) of entities in knowledge-graph embeddings.

``isi.open`` gives the home of a folder, to which a robot adds entities and facts, and
which answers; ``from_pykeen`` makes one of a PyKEEN model, ``train`` of triples. ``insert`` adds
new entities to arrays; ``isi.pykeen`` is for PyKEEN models;
``isi.benchmark`` hides entities of a graph, and ranks answers after their insertion.
``check_initializer`` and ``check_model`` check your own. They are imported on first use (types are
in ``__init__.pyi``).
"""

import importlib
from typing import Any

#: Module and name there of each name here.
_WHERE = {
    "Home": ("isi.home.home", "Home"),
    "InputError": ("isi.errors", "InputError"),
    "check_initializer": ("isi.checks.initializers", "check_initializer"),
    "check_model": ("isi.checks.models", "check_model"),
    "from_pykeen": ("isi.pykeen.open", "from_pykeen"),
    "insert": ("isi.insertion.api", "insert"),
    "open": ("isi.home.home", "open_home"),
    "train": ("isi.home.home", "train"),
}
#: Without ``open``: ``from isi import *`` leaves the builtin as it is.
__all__ = [name for name in _WHERE if name != "open"]
#: Packages of public names, which are imported on first use, too.
_PACKAGES = ("benchmark", "pykeen")


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE, *_PACKAGES])


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        module, there = _WHERE[name]
        return getattr(importlib.import_module(module), there)
    if name in _PACKAGES:
        return importlib.import_module(f"isi.{name}")
    raise AttributeError(f"module 'isi' has no attribute {name!r}")
