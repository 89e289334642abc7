"""Read thousands of changed files, and write the counts of outcomes to docs/benchmarks/fuzz.csv
(the run to runs.csv beside it): ``make fuzz``.

Faults (files neither read nor refused in one line within 10 s of processor time, giants within
20 s, and 2 GiB) go to .fuzz/, and the exit status is then 1.

python -m tools.fuzz [--inputs 10000] [--out FILE]
"""

import argparse
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from tools.docs import record, this_run
from tools.fuzz.campaign import OF_GIANTS, outcomes_of
from tools.fuzz.formats import FORMATS
from tools.fuzz.worker import Outcome

FAULTS = Path(".fuzz")
TABLE = Path("docs/benchmarks/fuzz.csv")


def table(outcomes: dict[str, list[Outcome]]) -> pd.DataFrame:
    """The table in docs/benchmarks/fuzz.csv, with a row for all formats."""
    rows = []
    for name, of_format in outcomes.items():
        kinds = [outcome.kind for outcome in of_format]
        rows.append(
            {
                "file format": name,
                "inputs": f"{len(kinds):,}",
                "read": f"{kinds.count('read'):,}",
                "refused in one line": f"{kinds.count('refused'):,}",
                "faults": kinds.count("fault"),
                "longest processor time (s)": f"{max(each.seconds for each in of_format):.1f}",
                "peak MiB": max(each.mib for each in of_format),
            }
        )
    return pd.DataFrame(rows)


def write_fault(folder: Path, fault: Outcome) -> None:
    """Write the files of a fault into a folder, and print the problem."""
    problem = fault.problem.encode(errors="backslashreplace")
    for path, content in (fault.files | {"fault.txt": problem}).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    print(f"{folder}: {fault.problem.strip().splitlines()[-1][:200]}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument(
        "--inputs", type=int, default=10_000, help="number of files over all formats (10,000)"
    )
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    options, run = parser.parse_args(), this_run()
    names = [*FORMATS, OF_GIANTS]
    share = -(-options.inputs // len(names))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        each = pool.map(outcomes_of, names, repeat(share))
        results = tqdm(each, total=len(names), unit=" formats", disable=None)
        outcomes = dict(zip(names, results, strict=True))
    every = [outcome for of_format in outcomes.values() for outcome in of_format]
    table(outcomes | {"all": every}).to_csv(options.out, index=False, lineterminator="\n")
    if options.out == TABLE:
        record(run, ["fuzz"])
    faults = [
        (name, outcome)
        for name, of_format in outcomes.items()
        for outcome in of_format
        if outcome.kind == "fault"
    ]
    for number, (name, fault) in enumerate(faults):
        print(f"{name}: ", end="")
        write_fault(FAULTS / str(number), fault)
    print(f"{len(every):,} inputs, {len(faults)} faults")
    sys.exit(f"{len(faults)} faults: their files are under {FAULTS}/" if faults else 0)


if __name__ == "__main__":
    main()
