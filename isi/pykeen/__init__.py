"""Insertion of new entities into a copy of a model trained by PyKEEN, and training afterwards."""

try:
    import pykeen  # noqa: F401
except ModuleNotFoundError as error:
    raise ImportError("isi.pykeen needs PyKEEN: pip install pykeen") from error

from isi.pykeen.insertion import enlarge, insert, inserted
from isi.pykeen.reading import InteractionModel, read_model
from isi.pykeen.training import fit_new, train_on, warm

__all__ = ["InteractionModel", "enlarge", "fit_new", "insert", "inserted", "read_model", "train_on", "warm"]
