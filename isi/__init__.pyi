from isi import pykeen as pykeen
from isi.errors import InputError as InputError
from isi.insertion.api import insert as insert
from isi.insertion.fit import fit_new as fit_new
from isi.live.embedding import LiveEmbedding as LiveEmbedding
from isi.live.train import train as train
from isi.pykeen.open import from_pykeen as from_pykeen

__all__ = ["InputError", "LiveEmbedding", "fit_new", "from_pykeen", "insert", "train"]
