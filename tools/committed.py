"""The files of the last commit, and the numbers of a report against them."""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

ROOT = Path(__file__).parent.parent
#: How much a number may differ on another processor, whose matrix products have other last digits,
#: so that training ends elsewhere: by a part of its key, then points of MRR. A run that does not
#: converge there counts up to 150 epochs in a mean over a hundred runs.
ALLOWED = {
    "graph": 0.0,
    "epochs_to_convergence": 3.0,
    "runs_without_convergence": 2.0,
    "gain_over_xavier_percent": 1.0,
    "drop_percent": 1.0,
    "affordances_percent": 5.0,
}
OTHERS = 0.5
NAMED = 5  #: Maximum number of differences that are named.


def git(*arguments: str, root: Path = ROOT) -> str | None:
    """What git prints about a folder; None without git, a repository, or what is asked for."""
    command = ["git", *arguments]
    try:
        done = subprocess.run(command, cwd=root, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.decode("utf-8")


def text_of(name: str, root: Path = ROOT) -> str | None:
    """The text of a file in the last commit; None without git, a repository, or the file in it."""
    return git("show", f"HEAD:./{name}", root=root)


def against_commit(name: str, root: Path = ROOT) -> str:
    """A line that compares the numbers of a file of JSON with those of the last commit."""
    before = text_of(name, root)
    if before is None:
        return f"Not compared with the committed report: no git, or no commit of {name}"
    return compared(json.loads((root / name).read_text(encoding="utf-8")), json.loads(before))


def compared(metrics: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    """A line that compares the numbers of two reports: how many are equal, how many differ as much
    as they may on another processor (``ALLOWED``), and the others by name.
    """
    numbers = pd.concat({"new": _numbers(metrics), "old": _numbers(before)}, axis=1).sort_index()
    both = numbers.dropna()
    apart = (both["new"] - both["old"]).abs()
    beyond = apart[apart > [_allowed(key) for key in both.index]]
    equal = (apart == 0).sum()
    line = f"Against the committed report: {equal} of {len(both)} numbers are equal"
    if near := len(both) - equal - len(beyond):
        line += f"; {near} differ as they may on another processor"
    if len(beyond):
        named = [
            f"{key} is {both['new'][key]:g}, not {both['old'][key]:g}"
            for key in beyond.sort_values(ascending=False).index[:NAMED]
        ]
        line += f"; {len(beyond)} differ more (docs/reproduce.md: go back): {', '.join(named)}"
        line += ", ..." if len(beyond) > NAMED else ""
    alone = len(numbers) - len(both)
    return f"{line}; {alone} are in one report only" if alone else line


def _allowed(key: str) -> float:
    """How much a number may differ, by its key."""
    return next((most for kind, most in ALLOWED.items() if kind in key.split(".")), OTHERS)


def _numbers(values: Mapping[str, Any]) -> pd.Series:
    """The numbers in a tree of mappings, by their keys with dots between."""
    flat = pd.json_normalize(dict(values)).T
    return pd.to_numeric(flat[0] if len(flat) else pd.Series(dtype=float), "coerce").dropna()
