"""Kill or starve runs of the pipeline, and write the outcomes to docs/benchmarks/kills.csv:
``make kill-test``.

In twenty runs of a small pipeline, the run, DVC, a stage or a worker gets KILL, TERM or INT at a
random moment. Further runs have a limit on the size of files, or a full file system. After each of
them, another run must give every output byte for byte as an undisturbed run does, and must leave no
process and no temporary file. As many processes that change a home are killed or starved: what they
have acknowledged must be there, and nothing half.

python -m tools.kills [--kills 20] [--disks 4] [--seed 0] [--out FILE]
"""

import argparse
import itertools
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from isi.live.home import Home
from tests.small_live import KNOWN
from tools.kills import home
from tools.kills.workspace import SIGNALS, WHOM, Fault, Lost, Workspace

TABLE = Path("docs/benchmarks/kills.csv")


@contextmanager
def disk() -> Iterator[tuple[Path, Callable[[int], object]]]:
    """Mount a file system in memory; yields its folder, and a function that sets its size in KiB.

    Raises:
        PermissionError: if this user may not mount.
    """
    mount = ["mount", "-t", "tmpfs", "tmpfs", "-o"]
    with tempfile.TemporaryDirectory() as folder:
        if subprocess.run([*mount, "size=1g", folder], capture_output=True).returncode:
            raise PermissionError
        try:
            yield (
                Path(folder),
                lambda kib: subprocess.run([*mount, f"remount,size={kib}k", folder], check=True),
            )
        finally:
            subprocess.run(["umount", "--lazy", folder], check=True)  # noqa: S607


def survived(where: Workspace, strike: Callable[[], Fault | None]) -> Fault | None:
    """Disturb a new run by ``strike``, continue it, and compare its outputs;
    None if the run ended before.
    """
    where.clear()
    fault = None
    try:
        fault = strike()
        if fault:
            where.finish()
            where.compare()
    except Lost as error:
        return replace(fault or Fault("the disk", "?", "?", 0), lost=str(error))
    return fault


def kills(where: Workspace, number: int, seconds: float, chosen: random.Random) -> Iterator[Fault]:
    """Send signals to processes of runs at random moments in [0, ``seconds``];
    pairs (process, signal) alternate.
    """
    ways = [(whom, cause) for whom in WHOM for cause in SIGNALS]
    order = [way for _ in range(-(-number // len(ways))) for way in chosen.sample(ways, len(ways))]
    for whom, cause in order[:number]:
        fault = None
        while fault is None:  # the run may end before the random moment
            after = chosen.uniform(0, seconds)
            fault = survived(where, partial(where.strike, whom, cause, after, chosen))
        yield replace(fault, whom=whom, cause=cause.name)


def limits(where: Workspace, number: int, chosen: random.Random) -> Iterator[Fault]:
    """Disturb runs by a limit of 2 to 100 KiB on the size of files."""
    for _ in range(number):
        fault = survived(
            where, partial(where.starve, chosen.choice([2, 5, 10, 20, 50, 100]) * 1024)
        )
        if fault:
            yield fault


def full_disks(expected: dict[str, str], number: int, chosen: random.Random) -> Iterator[Fault]:
    """Disturb runs by a full file system, which then gets space;
    yields nothing if this user may not mount.
    """
    for _ in range(number):
        with suppress(PermissionError), disk() as (folder, hold):
            where = Workspace(folder / "run")
            where.expected = expected
            used = shutil.disk_usage(folder).used // 1024

            def strike(
                where: Workspace = where, hold: Callable[[int], object] = hold, used: int = used
            ) -> Fault:
                hold(used + chosen.randrange(50, 1500))
                fault = where.starve()
                hold(2**20)
                return fault

            fault = survived(where, strike)
            if fault:
                yield fault


def of_homes(kills: int, disks: int, chosen: random.Random) -> Iterator[Fault]:
    """Kill processes that change one home after the other; then fill file systems by homes."""
    ways = itertools.cycle([(way, cause) for cause in SIGNALS for way in home.WAYS])
    with tempfile.TemporaryDirectory() as folder:
        for way, cause in itertools.islice(ways, kills):
            path = Path(folder) / way
            if not path.exists():
                Home.create(KNOWN, path).close()
            yield home.killed(path, way, cause, chosen)
    for way in itertools.islice(itertools.cycle(("tell", "train")), disks):
        with suppress(PermissionError), disk() as (folder, hold):
            Home.create(KNOWN, folder / "home").close()
            hold(shutil.disk_usage(folder).used // 1024 + chosen.randrange(100, 300))
            yield home.starved(folder / "home", way, partial(hold, 2**20))


def table(faults: Sequence[Fault]) -> str:
    """A CSV table with a row for each kind of process and signal, and one for all."""
    rows = pd.DataFrame(map(asdict, faults))
    rows = rows.assign(status=rows["status"] != 0, lost=rows["lost"] != "")
    both = pd.concat([rows, rows.assign(whom="all", cause="")])
    groups = both.groupby(["whom", "cause"], sort=False)
    counts = groups.agg(
        times=("stage", "size"),
        stages=("stage", "nunique"),
        ended=("status", "sum"),
        lost=("lost", "sum"),
    )
    names = ["target", "signal or fault", "trials", "different stages", "run ended", "data lost"]
    return counts.reset_index().set_axis(names, axis=1).to_csv(index=False, lineterminator="\n")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="of processes (20)")
    parser.add_argument(
        "--disks",
        type=int,
        default=4,
        help="number of full file systems, and of limits on files (4)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the random moments (0)")
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    given = parser.parse_args()
    chosen, faults = random.Random(given.seed), list[Fault]()
    with tempfile.TemporaryDirectory() as folder:
        where = Workspace(Path(folder))
        seconds = where.finish()
        where.expected = where.digests()
        every = itertools.chain(
            kills(where, given.kills, seconds, chosen),
            limits(where, given.disks, chosen),
            full_disks(where.expected, given.disks, chosen),
            of_homes(given.kills, given.disks, chosen),
        )
        for fault in tqdm(
            every, total=2 * given.kills + 3 * given.disks, unit=" faults", disable=None
        ):
            faults.append(fault)
            print(
                f"{fault.whom}, {fault.cause}, in {fault.stage}: {fault.lost or 'nothing lost'}",
                flush=True,
            )
    given.out.write_text(table(faults), encoding="utf-8")
    lost = sum(bool(fault.lost) for fault in faults)
    print(f"{len(faults)} faults, {lost} lost something; a run takes {seconds:.0f} s")
    sys.exit(bool(lost))


if __name__ == "__main__":
    main()
