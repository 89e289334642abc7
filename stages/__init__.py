"""The stages of the pipeline: each reads, calls isi, and writes.

Importing the package, which running a stage does first of all, ties the process to the one that
started it: DVC leaves its stage running when it is killed.
"""

import sys
from importlib.util import find_spec

if not all(find_spec(name) for name in ("pandas", "pyarrow", "pydantic", "torch")):
    sys.exit(f"stages: {sys.executable} lacks the packages of this project: use `make repro`, or activate .venv first")

from isi.base.lifetime import tie_to_parent

tie_to_parent()
