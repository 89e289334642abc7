"""Check all of params.yaml: DVC looks only at the keys that its stages name."""

from __future__ import annotations

import sys

from isi import params, paths
from isi.errors import InputError

if __name__ == "__main__":
    try:
        params.load(paths.PARAMS)
    except InputError as error:
        sys.exit(str(error))
