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
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from tools.fuzz.campaign import Counts, try_format, try_giants
from tools.fuzz.formats import FORMATS

FAULTS = Path(".fuzz")
TABLE = Path("docs/benchmarks/fuzz.csv")
COLUMNS = [
    "file format",
    "inputs",
    "read",
    "refused in one line",
    "faults",
    "longest processor time (s)",
    "peak MiB",
]


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
    given = parser.parse_args()
    names = [given.format] if given.format else list(FORMATS)
    share = -(-given.inputs // len(names))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        waiting = [pool.submit(try_format, name, share, given.seed) for name in names]
        waiting += [pool.submit(try_giants)] * (not given.format)
        for _ in tqdm(as_completed(waiting), total=len(waiting), unit=" formats", disable=None):
            pass
    counts = [future.result() for future in waiting]
    for of_format in counts:
        write_faults(of_format)
    rows = pd.DataFrame([of_format.row() for of_format in counts], columns=COLUMNS)
    total = {
        "file format": "all",
        **rows[COLUMNS[1:5]].sum(),
        **{name: rows[name].max() for name in COLUMNS[5:]},
    }
    if not given.format:
        table = pd.concat([rows, pd.DataFrame([total])])
        counts = {name: table[name].map("{:,}".format) for name in COLUMNS[1:5]}
        table.assign(**counts).to_csv(
            given.out, index=False, float_format="%.1f", lineterminator="\n"
        )
    print(f"{total['inputs']:,} inputs, {total['faults']} faults")
    sys.exit(f"{total['faults']} faults: their files are under {FAULTS}/" if total["faults"] else 0)


def write_faults(counts: Counts) -> None:
    """Write the files of each fault into a folder under .fuzz/, and print the problem."""
    for number, (problem, files) in enumerate(counts.faults):
        folder = FAULTS / f"{counts.format.replace(', ', ' ').replace(' ', '-')}-{number}"
        for name, content in {
            **files,
            "fault.txt": problem.encode(errors="backslashreplace"),
        }.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        print(f"{counts.format} ({folder}): {problem.strip().splitlines()[-1][:200]}")


if __name__ == "__main__":
    main()
