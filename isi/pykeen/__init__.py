"""Insertion of new entities into a copy of a model trained by PyKEEN, and training afterwards."""

from isi.errors import extra

with extra("pykeen"):
    import pykeen  # noqa: F401

from isi.pykeen.insertion import EnlargedModel, insert
from isi.pykeen.reading import InteractionModel, read_model
from isi.pykeen.training import train_on, warm

__all__ = [
    "EnlargedModel",
    "InteractionModel",
    "insert",
    "read_model",
    "train_on",
    "warm",
]
