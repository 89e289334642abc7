"""Kill or starve runs of the pipeline, and write the outcomes to docs/benchmarks/kills.csv
(the run to runs.csv beside it): ``make kill-test``.

In twenty runs of a small pipeline, the run, DVC, a stage or a worker gets KILL, TERM or INT at a
random moment. Further runs have a limit on the size of files, or a full file system. After each of
them, another run must give every output byte for byte as an undisturbed run does, and must leave no
process and no temporary file. As many processes that change a home are killed or starved: what they
have acknowledged must be there, and nothing half.

python -m tools.kills [--kills 20] [--out FILE]
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

from isi.home.folder import create
from tests.small_home import KNOWN
from tools.docs import record, this_run
from tools.kills import home
from tools.kills.workspace import SIGNALS, WHOM, Fault, Lost, Workspace

TABLE = Path("docs/benchmarks/kills.csv")
ALL = 2**20  #: The space of a file system that is not full, in KiB.


@contextmanager
def disk() -> Iterator[tuple[Path, Callable[[int], object]]]:
    """Mount a file system in memory; yields its folder, and a function that sets its size in KiB.

    Raises:
        PermissionError: if this user may not mount.
    """
    mount = ["mount", "-t", "tmpfs", "tmpfs", "-o"]
    with tempfile.TemporaryDirectory() as folder:
        if subprocess.run([*mount, f"size={ALL}k", folder], capture_output=True).returncode:
            raise PermissionError

        def hold(kib: int) -> None:
            subprocess.run([*mount, f"remount,size={kib}k", folder], check=True)

        try:
            yield Path(folder), hold
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


def limits(where: Workspace, number: int, chosen: random.Random) -> Iterator[Fault | None]:
    """Disturb runs by a limit of 2 to 100 KiB on the size of files."""
    for _ in range(number):
        limit = chosen.choice([2, 5, 10, 20, 50, 100]) * 1024
        yield survived(where, partial(where.starve, limit))


def full_disks(
    expected: dict[str, str], number: int, chosen: random.Random
) -> Iterator[Fault | None]:
    """Disturb runs by a full file system, which then gets space;
    yields nothing if this user may not mount.
    """

    def strike() -> Fault:
        hold(size)
        fault = where.starve()
        hold(ALL)
        return fault

    for _ in range(number):
        with suppress(PermissionError), disk() as (folder, hold):
            where = Workspace(folder / "run")
            where.expected = expected
            size = shutil.disk_usage(folder).used // 1024 + chosen.randrange(50, 1500)
            yield survived(where, strike)


def of_homes(kills: int, disks: int, chosen: random.Random) -> Iterator[Fault]:
    """Kill processes that change one home after the other; then fill file systems by homes."""
    ways = itertools.cycle([(way, cause) for cause in SIGNALS for way in home.WAYS])
    with tempfile.TemporaryDirectory() as folder:
        for way, cause in itertools.islice(ways, kills):
            path = Path(folder) / way
            if not path.exists():
                create(KNOWN, path).close()
            yield home.killed(path, way, cause, chosen)
    for way in itertools.islice(itertools.cycle(("tell", "train")), disks):
        with suppress(PermissionError), disk() as (folder, hold):
            create(KNOWN, folder / "home").close()
            hold(shutil.disk_usage(folder).used // 1024 + chosen.randrange(100, 300))
            yield home.starved(folder / "home", way, partial(hold, ALL))


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
    parser.add_argument("--out", type=Path, default=TABLE, help=f"the table ({TABLE})")
    given, run = parser.parse_args(), this_run()
    disks, chosen, faults = max(1, given.kills // 5), random.Random(0), list[Fault]()
    with tempfile.TemporaryDirectory() as folder:
        where = Workspace(Path(folder))
        seconds = where.finish()
        where.expected = where.digests()
        every = itertools.chain(
            kills(where, given.kills, seconds, chosen),
            limits(where, disks, chosen),
            full_disks(where.expected, disks, chosen),
            of_homes(given.kills, disks, chosen),
        )
        total = 2 * given.kills + 3 * disks
        for fault in filter(None, tqdm(every, total=total, unit=" faults", disable=None)):
            faults.append(fault)
            about = f"{fault.whom}, {fault.cause}, in {fault.stage}"
            print(f"{about}: {fault.lost or 'nothing lost'}", flush=True)
    given.out.write_text(table(faults), encoding="utf-8")
    if given.out == TABLE:
        record(run, ["kills"])
    lost = sum(bool(fault.lost) for fault in faults)
    print(f"{len(faults)} faults, {lost} lost something; a run takes {seconds:.0f} s")
    sys.exit(bool(lost))


if __name__ == "__main__":
    main()
