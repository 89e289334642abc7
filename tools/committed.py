"""The files of the last commit, and the numbers of a report against them."""

import json
import math
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

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
    new, old = dict(_numbers(metrics)), dict(_numbers(before))
    both = sorted(new.keys() & old.keys())
    apart = {key: abs(new[key] - old[key]) for key in both if new[key] != old[key]}
    line = (
        f"Against the committed report: {len(both) - len(apart)} of {len(both)} numbers are equal"
    )
    if apart:
        largest = max(apart, key=apart.__getitem__)
        line += f"; the largest difference is {apart[largest]:.2g}, in {largest}: "
        line += f"{new[largest]:g} instead of {old[largest]:g} (docs/change.md: go back)"
    alone = len(new) + len(old) - 2 * len(both)
    return f"{line}; {alone} are in one report only" if alone else line


def _numbers(values: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """The numbers in a tree of mappings, by their keys with dots between."""
    if isinstance(values, Mapping):
        for name, value in values.items():
            yield from _numbers(value, f"{key}.{name}" if key else name)
    elif isinstance(values, int | float) and math.isfinite(values):
        yield key, values
