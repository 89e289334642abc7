"""Sum up what became of mutants (``make mutants``) in docs/benchmarks/mutants.md, and list those that live."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pandas as pd

from tools.docs import BENCHMARKS, write_table

FOLDER = Path("mutants")
#: By the exit status of its tests, as mutmut has it; what has another was killed.
FATES = {0: "live", 5: "met by no test", 33: "met by no test", None: "not tried", 34: "not tried"}


def fates(folder: Path = FOLDER) -> dict[str, dict[str, str]]:
    """What became of each mutant, by file."""
    of_file = {}
    for path in sorted(folder.rglob("*.py.meta")):
        statuses = json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
        name = str(path.relative_to(folder)).removesuffix(".meta")
        of_file[name] = {mutant: FATES.get(status, "killed") for mutant, status in statuses.items()}
    return of_file


def table(of_file: dict[str, dict[str, str]]) -> pd.DataFrame:
    """A row for each package, and one for all."""
    counts: dict[str, Counter[str]] = {}
    for name, mutants in of_file.items():
        counts.setdefault(str(Path(name).parent), Counter()).update(mutants.values())
    counts["all"] = sum(counts.values(), Counter())
    return pd.DataFrame([
        {"code": name, "mutants": f"{count.total():,}"}
        | {fate: f"{count[fate]:,}" for fate in ("killed", "live", "met by no test")}
        | {"killed of all": f"{100 * count['killed'] / count.total():.1f} %"}
        for name, count in counts.items() if count
    ])  # fmt: skip


if __name__ == "__main__":
    write_table(BENCHMARKS / "mutants.md", table(fates()), 1)
    for path, mutants in fates().items():
        for mutant, fate in mutants.items():
            if fate != "killed":
                print(f"{path}: {mutant}: {fate}")
