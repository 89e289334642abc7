"""A small pipeline whose runs can be killed or starved of disk space."""

import hashlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from isi.config import read
from isi.process import tie_to_parent
from tests.environment import ENVIRONMENT
from tools import workspace

#: Params of a pipeline on one small graph, in which stages still use several workers.
SMALL: dict[str, Any] = {
    "experiments.ai2thor": workspace.DROP,
    "experiments.transfer": workspace.DROP,
    "experiments.paper_transfer": workspace.DROP,
    "sources.ai2thor": workspace.DROP,
    "sources.mp3d": workspace.DROP,
    "experiments.paper.sessions.seeds": 3,
    "experiments.paper.sessions.sizes": [1, 2],
    "experiments.paper.full_curves": [2],
    "experiments.paper.initializers": ["xavier", "ers"],
    "embedding.dimension": 8,
    "training.max_epochs": 4,
    "training.evaluate_every": 2,
    "finetuning.max_epochs": 3,
    "compute.stack": 1,
    "compute.workers": 2,
    "sweep.experiments": [],
    "final_model.experiments": ["paper"],
}
SMALL |= {
    f"initializers.{name}": workspace.DROP
    for name in read(workspace.ROOT / "params.yaml")["initializers"]
    if name not in SMALL["experiments.paper.initializers"]
}
WHOM = ("make repro", "DVC", "a stage", "a worker")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
#: Maximum seconds until a disturbed run ends, and until all processes of its session are gone.
MOST, GONE = 600, 30
#: Errors of calls about a process that has ended.
ENDED = (psutil.Error, OSError)
#: The command of ``make repro``.
REPRO = [sys.executable, str(Path(workspace.__file__).with_name("repro.py"))]


@dataclass(frozen=True)
class Fault:
    """A disturbance of a run: the process (or the disk), the signal (or the limit),
    and its effect.
    """

    whom: str
    cause: str
    #: the stage that was running
    stage: str
    #: exit status of the run; 0 if it recovered
    status: int
    #: description of the loss; empty if nothing was lost
    lost: str = ""


class Lost(Exception):
    """A fault that caused a loss: the message names the files that differ, the process that stays,
    or the failure.
    """


class Workspace:
    """A small pipeline, or some of its stages (``targets``),
    and the digests of the outputs of an undisturbed run.

    Each run starts without outputs, except those in the folders ``inputs`` of ``data``.
    """

    def __init__(
        self, folder: Path, targets: Sequence[str] = (), inputs: Sequence[str] = ()
    ) -> None:
        workspace.make(folder, SMALL)
        self.folder, self.targets, self.inputs = folder, targets, inputs
        self.expected = dict[str, str]()

    def begin(self, limit: int | None = None) -> subprocess.Popen[str]:
        """Start a run in a new session; ``limit``: maximum size of its files in bytes."""
        # with a limit, files of bytecode would be cut, too, and break later runs
        bytecode = {} if limit is None else {"PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.Popen(
            [*REPRO, *self.targets],
            cwd=self.folder,
            env={**ENVIRONMENT, **bytecode},
            start_new_session=True,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=partial(prepare_process, os.getpid(), limit),
        )

    def finish(self) -> float:
        """Run the stages that are left; returns the seconds.

        Raises:
            Lost: if the run fails or leaves a process.
        """
        start = time.monotonic()
        run = self.begin()
        _, err = run.communicate()
        if run.returncode:
            raise Lost(f"the next run fails: {' '.join(err.split())[-300:]}")
        _nobody_left(run.pid)
        return time.monotonic() - start

    def compare(self) -> None:
        """Compare the outputs with the expected digests.

        Raises:
            Lost: if a file differs, is missing or is left over.
        """
        differs = sorted({name for name, _ in self.digests().items() ^ self.expected.items()})
        if differs:
            raise Lost(f"{len(differs)} files differ, lack or stay: {', '.join(differs[:5])}")

    def digests(self) -> dict[str, str]:
        """SHA-256 by path of all outputs: data, reports and the lock file."""
        made = [
            path
            for part in ("data", "reports", "dvc.lock")
            for path in [self.folder / part, *(self.folder / part).rglob("*")]
            if path.is_file() and not path.is_relative_to(self.folder / "data/raw")
        ]
        return {
            str(path.relative_to(self.folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in made
        }

    def clear(self) -> None:
        """Remove all outputs except ``inputs``, and DVC's cache; DVC's other files stay."""
        kept = {"raw", *self.inputs}
        outputs = [path for path in (self.folder / "data").iterdir() if path.name not in kept]
        for path in [*outputs, self.folder / ".dvc/cache", self.folder / "reports"]:
            shutil.rmtree(path, ignore_errors=True)
        if not self.inputs:
            (self.folder / "dvc.lock").unlink(missing_ok=True)

    def strike(
        self,
        whom: str,
        cause: signal.Signals,
        after: float,
        chosen: random.Random,
        running: str = "",
    ) -> Fault | None:
        """Start a run, and send a signal to one of its processes after ``after`` seconds;
        None if the run has ended.

        Args:
            running: wait until a process of this kind runs (default: the kind ``whom``, which gets
                the signal).

        Raises:
            Lost: if the run does not end, or leaves a process.
        """
        run = self.begin()
        with _ended(run):
            time.sleep(after)
            while run.poll() is None and not _victims(run.pid, running or whom):
                time.sleep(0.02)
            if run.poll() is not None or not (victims := _victims(run.pid, whom)):
                return None
            stage = _stage_of(run.pid)
            with suppress(*ENDED):
                chosen.choice(victims).send_signal(cause)
            try:
                run.communicate(timeout=MOST)
            except subprocess.TimeoutExpired as error:
                raise Lost(f"the run never ends, in {stage}") from error
            _nobody_left(run.pid)
            return Fault(whom, cause.name, stage, run.returncode)

    def starve(self, limit: int | None = None) -> Fault:
        """Run without enough space: the disk is full,
        or files have a maximum size of ``limit`` bytes.

        Raises:
            Lost: if the run succeeds, prints a traceback, or leaves a process.
        """
        run = self.begin(limit)
        with _ended(run):
            _, err = run.communicate()
            _nobody_left(run.pid)
        if not run.returncode:
            raise Lost("the run ended well")
        refusals = [line for line in err.splitlines() if "cannot be written" in line]
        if refusals and "Traceback" in err:
            raise Lost(f"a traceback: {' '.join(err.split())[-300:]}")
        stage = refusals[0].partition(":")[0] if refusals else "DVC itself"
        cause = "full" if limit is None else "files of some KiB at most"
        return Fault("the disk", cause, stage, run.returncode)


def prepare_process(parent: int, limit: int | None) -> None:
    """End this process with the test, accept Ctrl-C even if the test's parent ignores it,
    and limit file sizes.
    """
    tie_to_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


@contextmanager
def _ended(run: subprocess.Popen[str]) -> Iterator[None]:
    """Kill all processes of a run in the end, even if the test fails."""
    try:
        yield
    finally:
        for process in _session(run.pid):
            with suppress(*ENDED):
                process.kill()
        run.wait()
        if run.stderr:
            run.stderr.close()


def _session(leader: int) -> list[psutil.Process]:
    """Processes of the session with this leader, including zombies (ended, but not yet waited for).

    DVC regards zombies as alive, and keeps their locks.
    """
    processes = []
    for process in psutil.process_iter():
        with suppress(*ENDED):
            if os.getsid(process.pid) == leader:
                processes.append(process)
    return processes


def _nobody_left(leader: int) -> None:
    deadline = time.monotonic() + GONE
    while left := _session(leader):
        if time.monotonic() > deadline:
            raise Lost(f"a process stays: {left[0]}")
        time.sleep(0.05)


def _victims(leader: int, whom: str) -> list[psutil.Process]:
    """Processes of kind ``whom`` (``WHOM``) in a run:
    itself, DVC, the running stage, or the stage's workers.
    """
    level = [psutil.Process(leader)]
    for _ in range(WHOM.index(whom)):
        below = []
        for process in level:
            with suppress(*ENDED):
                below += process.children()
        level = below
    return level


def _stage_of(leader: int) -> str:
    for process in _victims(leader, "a stage"):
        with suppress(*ENDED):
            return " ".join(process.cmdline()).partition("stages.")[2]
    return "between stages"
