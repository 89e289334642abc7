from isi import benchmark as benchmark
from isi import pykeen as pykeen
from isi.checks.initializers import check_initializer as check_initializer
from isi.checks.models import check_model as check_model
from isi.errors import InputError as InputError
from isi.home.home import Home as Home
from isi.home.home import open_home
from isi.home.home import train as train
from isi.insertion.api import insert as insert
from isi.pykeen.open import from_pykeen as from_pykeen

open = open_home

__all__ = [
    "Home",
    "InputError",
    "check_initializer",
    "check_model",
    "from_pykeen",
    "insert",
    "train",
]
