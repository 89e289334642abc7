"""Insertion of new entities into a copy of a model trained by PyKEEN, and training afterwards."""

from isi.errors import extra

with extra("pykeen"):
    import pykeen  # noqa: F401

from isi.pykeen.before import compute_rows, enlarge, fit_new
from isi.pykeen.before import compute_rows as inserted  # the name in version 0.2
from isi.pykeen.insertion import EnlargedModel, insert
from isi.pykeen.reading import InteractionModel, read_model
from isi.pykeen.training import train_on, warm

__all__ = [
    "EnlargedModel",
    "InteractionModel",
    "compute_rows",
    "enlarge",
    "fit_new",
    "insert",
    "inserted",
    "read_model",
    "train_on",
    "warm",
]
