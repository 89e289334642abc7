from isi import pykeen as pykeen
from isi.inserting.fitting import fit_new as fit_new
from isi.inserting.insert import insert as insert

__all__ = ["fit_new", "insert"]
