"""Sum up what became of mutants (``make mutants``) in docs/benchmarks/mutants.md, and list those that live."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from tabulate import tabulate

FOLDER = Path("mutants")
TABLE = Path(__file__).parents[1] / "docs" / "benchmarks" / "mutants.md"
#: By the exit status of its tests, as mutmut has it; what has another was killed.
FATES = {"live": (0,), "met by no test": (5, 33), "not tried": (None, 34)}


def counts(folder: Path = FOLDER) -> dict[str, Counter[str]]:
    """How many mutants of each room were killed, live, or are met by no test."""
    rooms: dict[str, Counter[str]] = {}
    for path, statuses in results(folder).items():
        room = path if path.startswith("isi/learning/") else str(Path(path).parent)
        rooms.setdefault(room, Counter()).update(map(_fate, statuses.values()))
    return rooms


def results(folder: Path = FOLDER) -> dict[str, dict[str, int | None]]:
    """Exit statuses by file and mutant."""
    files = sorted(folder.rglob("*.py.meta"))
    found = {path: json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"] for path in files}
    return {str(path.relative_to(folder)).removesuffix(".meta"): statuses for path, statuses in found.items()}


def _fate(status: int | None) -> str:
    return next((fate for fate, listed in FATES.items() if status in listed), "killed")


def table(rooms: dict[str, Counter[str]]) -> str:
    """A row for each room, and one for all."""
    rows = {**rooms, "all": sum(rooms.values(), Counter())}
    return tabulate(
        [
            (name, f"{own.total():,}", *(f"{own[fate]:,}" for fate in ("killed", "live", "met by no test")),
             f"{100 * own['killed'] / own.total():.1f} %")
            for name, own in rows.items()
        ],
        ["code", "mutants", "killed", "live", "met by no test", "killed of all"],
        "pipe",
        colalign=("left", *["right"] * 5),
        disable_numparse=True,
    ) + "\n"  # fmt: skip


if __name__ == "__main__":
    TABLE.write_text(table(counts()), encoding="utf-8")
    for path, statuses in results().items():
        for name, status in statuses.items():
            if _fate(status) != "killed":
                print(f"{path}: {name}: {_fate(status)}")
