"""Read thousands of changed files, and write the counts of outcomes to docs/benchmarks/fuzz.csv:
``make fuzz``.

Faults (files neither read nor refused in one line within 10 s and 2 GiB) go to .fuzz/, and the exit
status is then 1.

python -m tools.fuzz [--inputs 10000] [--seed 0] [--format NAME] [--out FILE]
"""

import argparse
import multiprocessing
import os
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from tools.fuzz.campaign import OF_GIANTS, try_format
from tools.fuzz.formats import FORMATS
from tools.fuzz.worker import Outcome

FAULTS = Path(".fuzz")
TABLE = Path("docs/benchmarks/fuzz.csv")


def row(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The row of the table in docs/benchmarks/fuzz.csv."""
    kinds = Counter(outcome.kind for outcome in outcomes)
    return {
        "file format": name,
        "inputs": f"{len(outcomes):,}",
        "read": f"{kinds['read']:,}",
        "refused in one line": f"{kinds['refused']:,}",
        "faults": kinds["fault"],
        "longest processor time (s)": f"{max(outcome.seconds for outcome in outcomes):.1f}",
        "peak MiB": max(outcome.mib for outcome in outcomes),
    }


def write_faults(name: str, outcomes: Sequence[Outcome]) -> None:
    """Write the files of each fault into a folder under .fuzz/, and print the problem."""
    faults = [outcome for outcome in outcomes if outcome.kind == "fault"]
    for number, fault in enumerate(faults):
        folder = FAULTS / f"{name.replace(', ', ' ').replace(' ', '-')}-{number}"
        problem = fault.problem.encode(errors="backslashreplace")
        for path, content in (fault.files | {"fault.txt": problem}).items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
        print(f"{name} ({folder}): {fault.problem.strip().splitlines()[-1][:200]}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument(
        "--inputs", type=int, default=10_000, help="number of files over all formats (10,000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the random changes (0)")
    parser.add_argument(
        "--format", choices=list(FORMATS), help="only this format; docs are not written"
    )
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    options = parser.parse_args()
    names = [options.format] if options.format else [*FORMATS, OF_GIANTS]
    share = -(-options.inputs // len(names))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        waiting = {name: pool.submit(try_format, name, share, options.seed) for name in names}
        for _ in tqdm(
            as_completed(waiting.values()), total=len(names), unit=" formats", disable=None
        ):
            pass
    outcomes = {name: future.result() for name, future in waiting.items()}
    for name, of_format in outcomes.items():
        write_faults(name, of_format)
    total = row("all", [outcome for of_format in outcomes.values() for outcome in of_format])
    if not options.format:
        rows = [row(name, of_format) for name, of_format in outcomes.items()]
        pd.DataFrame([*rows, total]).to_csv(options.out, index=False, lineterminator="\n")
    print(f"{total['inputs']} inputs, {total['faults']} faults")
    sys.exit(f"{total['faults']} faults: their files are under {FAULTS}/" if total["faults"] else 0)


if __name__ == "__main__":
    main()
