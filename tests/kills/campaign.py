"""Faults by the dozen, and what became of the runs that had them."""

from __future__ import annotations

import random
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from tests.kills.workspace import SIGNALS, WHOM, Fault, Lost, Workspace


@contextmanager
def disk() -> Iterator[tuple[Path, Callable[[int], object]]]:
    """A file system in memory, and what sets how many KiB it holds.

    Raises:
        PermissionError: where this user may not mount.
    """
    mount = ["mount", "-t", "tmpfs", "tmpfs", "-o"]
    with tempfile.TemporaryDirectory() as folder:
        if subprocess.run([*mount, "size=1g", folder], capture_output=True).returncode:
            raise PermissionError
        try:
            yield Path(folder), lambda kib: subprocess.run([*mount, f"remount,size={kib}k", folder], check=True)
        finally:
            subprocess.run(["umount", "--lazy", folder], check=True)  # noqa: S607


def survived(where: Workspace, strike: Callable[[], Fault | None]) -> Fault | None:
    """Strike a run from the start, go on with it, and compare; null where nothing was struck."""
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
    """Signal processes of runs at random moments, each kind of process by each signal in turn."""
    ways = [(whom, how) for whom in WHOM for how in SIGNALS]
    order = [way for _ in range(-(-number // len(ways))) for way in chosen.sample(ways, len(ways))]
    for whom, how in order[:number]:
        fault = None
        while fault is None:  # its moment may lie behind the last stage
            after = chosen.uniform(0, seconds)
            fault = survived(where, partial(where.strike, whom, how, after, chosen))
        yield replace(fault, whom=whom, how=how.name)


def limits(where: Workspace, number: int, chosen: random.Random) -> Iterator[Fault]:
    """Let files grow to some KiB alone."""
    for _ in range(number):
        fault = survived(where, partial(where.starve, chosen.choice([2, 5, 10, 20, 50, 100]) * 1024))
        if fault:
            yield fault


def full_disks(expected: dict[str, str], number: int, chosen: random.Random) -> Iterator[Fault]:
    """Give a run less room than it takes, and then enough; without the right to mount, none."""
    for _ in range(number):
        with suppress(PermissionError), disk() as (folder, hold):
            where = Workspace(folder / "run")
            where.expected = expected
            used = shutil.disk_usage(folder).used // 1024

            def strike(where: Workspace = where, hold: Callable[[int], object] = hold, used: int = used) -> Fault:
                hold(used + chosen.randrange(50, 1500))
                fault = where.starve()
                hold(2**20)
                return fault

            fault = survived(where, strike)
            if fault:
                yield fault
