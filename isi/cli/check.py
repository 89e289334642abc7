"""See whether the tables under data/ hold their rules and are what their stages wrote, or accept edited ones."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from isi import config
from isi.cli._accepting import accept
from isi.cli._checking import Checking
from isi.tables import paths


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    accepting = "take the values of a table or of tensors that you have edited as what its stage wrote"
    parser.add_argument("--accept", metavar="FILE", nargs="+", type=Path, default=[], help=accepting)


def run(arguments: argparse.Namespace) -> None:
    """Check all, one line a finding; or accept files.

    Raises:
        InputError: where a file cannot be accepted, or there is no project here.
    """
    checking = Checking(config.read(paths.PARAMS))
    if arguments.accept:
        for line in accept([_within(path) for path in arguments.accept], checking):
            print(line)
        return
    found = list(dict.fromkeys(str(finding) for finding in checking.findings()))
    print(*found, sep="\n", end="\n" * bool(found))
    nothing = "" if checking.files else ": nothing has run (`dvc repro`)"
    print(f"{checking.files:,} files under {paths.DATA}, {len(found):,} findings{nothing}")
    if found:
        sys.exit(1)


def _within(path: Path) -> Path:
    """As the pipeline names it: relative to the folder of the project."""
    return Path(os.path.relpath(path)) if path.is_absolute() else path
