"""Strike runs of the pipeline, and write what became of them into docs/benchmarks/kills.md: ``make kill-test``.

Twenty runs of a small pipeline are struck at a random moment: the run, DVC, a stage or a worker, by KILL, TERM or INT;
then some whose files may not grow, or whose file system is full. After each, another run has to make every output the
same to the byte as one that nobody disturbed, with no process or temporary file left.

python -m tests.kills [--kills 20] [--disks 4] [--seed 0] [--out FILE]
"""

from __future__ import annotations

import argparse
import itertools
import random
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tabulate import tabulate
from tqdm import tqdm

from tests.kills.campaign import full_disks, kills, limits
from tests.kills.workspace import Fault, Workspace

TABLE = Path("docs/benchmarks/kills.md")


def table(faults: Sequence[Fault]) -> str:
    """A row for each way in which runs were struck."""
    ways: dict[tuple[str, str], list[Fault]] = {}
    for fault in faults:
        ways.setdefault((fault.whom, fault.how), []).append(fault)
    ways["all", ""] = list(faults)
    return tabulate(
        [
            (whom, how, len(found), len({fault.stage for fault in found}),
             sum(fault.status != 0 for fault in found), sum(bool(fault.lost) for fault in found))
            for (whom, how), found in ways.items()
        ],
        ["struck", "by", "times", "in as many stages", "the run ended", "lost something"],
        "pipe",
    ) + "\n"  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="of processes (20)")
    parser.add_argument("--disks", type=int, default=4, help="full file systems, and as many limits of files (4)")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn (0)")
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    given = parser.parse_args()
    chosen, faults = random.Random(given.seed), list[Fault]()
    with tempfile.TemporaryDirectory() as folder:
        where = Workspace(Path(folder))
        seconds = where.finish()
        where.expected = where.digests()
        every = itertools.chain(
            kills(where, given.kills, seconds, chosen), limits(where, given.disks, chosen),
            full_disks(where.expected, given.disks, chosen),
        )  # fmt: skip
        for fault in tqdm(every, total=given.kills + 2 * given.disks, unit=" faults", disable=None):
            faults.append(fault)
            print(f"{fault.whom}, {fault.how}, in {fault.stage}: {fault.lost or 'nothing lost'}", flush=True)
    given.out.write_text(table(faults), encoding="utf-8")
    lost = sum(bool(fault.lost) for fault in faults)
    print(f"{len(faults)} faults, {lost} lost something; a run takes {seconds:.0f} s")
    sys.exit(bool(lost))


if __name__ == "__main__":
    main()
