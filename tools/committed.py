"""The files of the last commit, and the numbers of a report against them."""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

ROOT = Path(__file__).parent.parent


def text_of(name: str, root: Path = ROOT) -> str | None:
    """The text of a file in the last commit; None without git, a repository, or the file in it."""
    command = ["git", "show", f"HEAD:./{name}"]
    try:
        shown = subprocess.run(command, cwd=root, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return shown.stdout.decode("utf-8")


def against_commit(name: str, root: Path = ROOT) -> str:
    """A line that compares the numbers of a file of JSON with those of the last commit."""
    before = text_of(name, root)
    if before is None:
        return f"Not compared with the committed report: no git, or no commit of {name}"
    return compared(json.loads((root / name).read_text(encoding="utf-8")), json.loads(before))


def compared(metrics: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    """A line that compares the numbers of two reports:
    how many are equal, and the largest difference.
    """
    numbers = pd.concat({"new": _numbers(metrics), "old": _numbers(before)}, axis=1).sort_index()
    both = numbers.dropna()
    apart = (both["new"] - both["old"]).abs()
    equal = (apart == 0).sum()
    line = f"Against the committed report: {equal} of {len(both)} numbers are equal"
    if equal < len(both):
        largest = apart.idxmax()
        new, old = both.loc[largest]
        line += f"; the largest difference is {apart[largest]:.2g}, in {largest}: "
        line += f"{new:g} instead of {old:g} (docs/reproduce.md: go back)"
    alone = len(numbers) - len(both)
    return f"{line}; {alone} are in one report only" if alone else line


def _numbers(values: Mapping[str, Any]) -> pd.Series:
    """The numbers in a tree of mappings, by their keys with dots between."""
    flat = pd.json_normalize(dict(values)).T
    return pd.to_numeric(flat[0] if len(flat) else pd.Series(dtype=float), "coerce").dropna()
