from isi import pykeen as pykeen
from isi.bundle.live import LiveEmbedding as LiveEmbedding
from isi.bundle.live import open_live as open
from isi.bundle.train import train as train
from isi.errors import InputError as InputError
from isi.insertion.api import insert as insert
from isi.insertion.fit import fit_new as fit_new
from isi.pykeen.live import of as of

__all__ = ["InputError", "LiveEmbedding", "fit_new", "insert", "of", "open", "train"]
