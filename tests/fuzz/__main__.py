"""Read inputs by the thousand and write what became of them into docs/benchmarks/fuzz.md: ``make fuzz``.

What is neither read nor refused in one line within ten seconds and 2 GiB is kept under .fuzz/, and the status is 1.

python -m tests.fuzz [--inputs 10000] [--seed 0] [--format NAME] [--out FILE]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from tqdm import tqdm

from tests.fuzz.campaign import Counts, giants, of_format
from tests.fuzz.formats import FORMATS

KEPT = Path(".fuzz")
TABLE = Path("docs/benchmarks/fuzz.md")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000, help="of all formats together (10,000)")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn (0)")
    parser.add_argument("--format", choices=list(FORMATS), help="one alone; nothing is written into docs")
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    given = parser.parse_args()
    names = [given.format] if given.format else list(FORMATS)
    share = -(-given.inputs // len(names))
    start = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        waiting = [pool.submit(giants)] * (not given.format)
        waiting += [pool.submit(of_format, name, share, given.seed) for name in names]
        for _ in tqdm(as_completed(waiting), total=len(waiting), unit=" formats", disable=None):
            pass
        found = [one.result() for one in waiting]
    found = [*found[1:], found[0]] if not given.format else found
    keep(found)
    if not given.format:
        given.out.write_text(table(found), encoding="utf-8")
    faults = sum(len(counts.faults) for counts in found)
    total = sum(counts.inputs for counts in found)
    print(f"{total:,} inputs in {time.perf_counter() - start:.0f} s, {faults} faults")
    sys.exit(f"{faults} faults: their files are under {KEPT}/" if faults else 0)


def keep(found: Sequence[Counts]) -> None:
    """Keep the files of faults, each in a folder of its own, and say what is wrong with them."""
    for counts in found:
        for number, (said, files) in enumerate(counts.faults):
            folder = KEPT / f"{counts.format.replace(', ', ' ').replace(' ', '-')}-{number}"
            for name, content in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(content)
            print(f"{counts.format} ({folder}): {said.strip().splitlines()[-1][:200]}")
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "fault.txt").write_text(said, encoding="utf-8", errors="backslashreplace")


def table(found: Sequence[Counts]) -> str:
    """Rows of formats, and one of all."""
    every = Counts("all", sum(one.read for one in found), sum(one.refused for one in found),
                   max(one.seconds for one in found), max(one.mib for one in found),
                   [fault for one in found for fault in one.faults])  # fmt: skip
    lines = [
        "| changed files of | inputs | read | refused in one line | faults | longest s (of a processor) | peak MiB |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {one.format} | {one.inputs:,} | {one.read:,} | {one.refused:,} | {len(one.faults)} "
            f"| {one.seconds:.1f} | {one.mib:,} |"
            for one in [*found, every]
        ),
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
