"""A cluster of a Dask scheduler and two workers on loopback."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.environment import wait_for

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True)
class Cluster:
    scheduler: str  #: address
    workers: dict[int, subprocess.Popen[bytes]]  #: by process id


@contextmanager
def two_workers(folder: Path) -> Iterator[Cluster]:
    """A cluster in other processes, which end with the context;
    ``folder`` gets the address and logs.
    """
    at, started = folder / "scheduler.json", list[subprocess.Popen[bytes]]()

    def start(program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.{program}",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
        ]
        with (folder / f"{len(started)}.log").open("wb") as log:
            process = subprocess.Popen(
                [*command, "--scheduler-file", str(at), *arguments],
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
                stdout=log,
                stderr=log,
            )
        started.append(process)
        return process

    try:
        start("dask_scheduler", "--port", "0")
        workers = [start("dask_worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        assert wait_for(
            lambda: all(b"Registered to" in (folder / f"{n}.log").read_bytes() for n in (1, 2))
        )
        address = json.loads(at.read_text(encoding="utf-8"))["address"]
        yield Cluster(address, {process.pid: process for process in workers})
    finally:
        for process in started:
            process.kill()
            process.wait()
