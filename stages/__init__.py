"""The stages of the pipeline: each reads, calls isi, and writes.

Importing the package, which running a stage does first of all, ties the process to the one that
started it (DVC leaves its stage running when it is killed), and has it answer Ctrl-C in one line.
"""

import sys
from importlib.util import find_spec

# fmt: off
if sys.version_info < (3, 11) or not all(find_spec(name) for name in (
    "gensim", "jinja2", "matplotlib", "networkx", "numba", "numpy", "pandas", "procthor", "pyarrow", "pydantic",
    "rdflib", "ruamel", "safetensors", "scipy", "smart_open", "tabulate", "torch", "tqdm",
)):
    sys.exit(f"stages: {sys.executable} lacks the packages of this project: use `make repro`, or activate .venv first")
# fmt: on

from isi.process import stop_in_one_line, tie_to_parent

tie_to_parent()
if sys.argv[0] == "-m":  # run, not imported
    stop_in_one_line("stages", "run it again")
