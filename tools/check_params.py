"""Check all of params.yaml: DVC looks only at the keys that its stages name."""

from __future__ import annotations

import sys

from isi.base.errors import InputError
from isi.params import load

if __name__ == "__main__":
    try:
        load()
    except InputError as error:
        sys.exit(str(error))
