from isi import pykeen as pykeen
from isi.errors import InputError as InputError
from isi.insertion.api import insert as insert
from isi.insertion.fit import fit_new as fit_new

__all__ = ["InputError", "fit_new", "insert"]
