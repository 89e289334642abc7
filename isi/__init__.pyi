from isi import pykeen as pykeen
from isi.base.errors import InputError as InputError
from isi.inserting.fitting import fit_new as fit_new
from isi.inserting.insert import insert as insert

__all__ = ["InputError", "fit_new", "insert"]
