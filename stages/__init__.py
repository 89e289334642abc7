"""The stages of the pipelines: each reads tables, calls isi, and writes tables.

Python imports this package before a stage, so that Ctrl-C ends a stage in one line even during slow
imports.
"""

import sys
from importlib.util import find_spec

if sys.version_info < (3, 11) or not all(
    map(find_spec, ("numpy", "pandas", "pyarrow", "pydantic", "ruamel", "torch"))
):
    sys.exit(
        f"stages: {sys.executable} cannot run this project: use `make repro`, "
        "or activate .venv first"
    )

from isi.process import handle_stop_signals, tie_to_parent

if sys.argv[0] == "-m":  # run, not imported
    tie_to_parent()  # a killed DVC leaves its stage running
    handle_stop_signals("stages")
