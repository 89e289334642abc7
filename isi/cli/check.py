"""``isi check``: check the tables and tensors under data/ against their rules and against each other."""

from __future__ import annotations

import sys

from isi.params import load
from isi.tables import paths


def check() -> None:
    """Print one line for each problem.

    Raises:
        InputError: where there is no project here.
    """
    from isi.cli._checking import check_data  # here, since it loads torch

    number, problems = check_data(load())
    print(*problems, sep="\n", end="\n" * bool(problems))
    nothing = "" if number else ": nothing has run (`dvc repro`)"
    print(f"{number:,} files under {paths.DATA}, {len(problems):,} problems{nothing}")
    if problems:
        sys.exit(1)
