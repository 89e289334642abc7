"""Count the mutants that tests killed (``make mutants``) in docs/benchmarks/mutants.csv,
and list the others.
"""

import json
from collections import Counter
from pathlib import Path

import pandas as pd

from tools.docs import record, this_run, write_table

#: Result of a mutant by the exit status in mutmut's files; any other status: killed.
FATES = {0: "alive", 5: "run by no test", 33: "run by no test", None: "not tried", 34: "not tried"}
#: Columns of the table; the share killed is of those that were tried.
SHOWN = ("killed", "alive", "run by no test", "not tried")


def tried(count: Counter[str]) -> int:
    """The number of mutants that were tried."""
    return count.total() - count["not tried"]


def main() -> None:
    """Write a row for each package and a row "all"; print the mutants that were not killed."""
    run = this_run()
    counts: dict[str, Counter[str]] = {}
    survivors = []
    for path in sorted(Path("mutants").rglob("*.py.meta")):
        name = path.relative_to("mutants")
        statuses = json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
        fates = {mutant: FATES.get(status, "killed") for mutant, status in statuses.items()}
        counts.setdefault(str(name.parent), Counter()).update(fates.values())
        survivors += [
            f"{name.with_suffix('')}: {mutant}: {fate}"
            for mutant, fate in fates.items()
            if fate != "killed"
        ]
    counts["all"] = sum(counts.values(), Counter())
    table = pd.DataFrame(
        [
            {"code": name, "mutants": f"{count.total():,}"}
            | {fate: f"{count[fate]:,}" for fate in SHOWN}
            | {"share killed": f"{100 * count['killed'] / tried(count):.1f} %"}
            for name, count in counts.items()
            if tried(count)
        ]
    )
    write_table("mutants", table)
    record(run, ["mutants"])
    print(*survivors, sep="\n")


if __name__ == "__main__":
    main()
