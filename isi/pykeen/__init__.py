"""Insertion of new entities into a copy of a model trained by PyKEEN, and training afterwards."""

import warnings
from typing import Any

from isi.errors import extra

with extra("pykeen"):
    import pykeen  # noqa: F401

from isi.pykeen.insertion import compute_rows, enlarge, insert
from isi.pykeen.reading import InteractionModel, read_model
from isi.pykeen.training import fit_new, train_on, warm

__all__ = [
    "InteractionModel",
    "compute_rows",
    "enlarge",
    "fit_new",
    "insert",
    "read_model",
    "train_on",
    "warm",
]


def __getattr__(name: str) -> Any:
    if name == "inserted":  # the name in version 0.2
        message = "isi.pykeen.inserted is now isi.pykeen.compute_rows"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return compute_rows
    raise AttributeError(f"module 'isi.pykeen' has no attribute {name!r}")
