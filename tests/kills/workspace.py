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

from isi.process import tie_to_parent
from tests.environment import ENVIRONMENT
from tools import workspace

#: A pipeline of one small graph, whose stages yet share their tasks among workers.
SMALL: dict[str, Any] = {
    "experiments.ai2thor": workspace.DROP, "experiments.transfer": workspace.DROP,
    "sources.ai2thor": workspace.DROP, "sources.mp3d": workspace.DROP,
    "experiments.published.sessions.seeds": 3, "experiments.published.sessions.sizes": [1, 2],
    "experiments.published.full_curves.sizes": [2], "experiments.published.initializers": ["xavier", "ers"],
    "embedding.dimension": 8, "training.max_epochs": 4, "training.evaluate_every": 2, "finetuning.max_epochs": 3,
    "compute.stack": 1, "compute.workers": 2, "final_model.experiments": ["published"],
    **{f"initializers.{name}": workspace.DROP for name in (
        "iu", "es", "rs", "mean", "kind_mean", "gaussian", "gaussian_centred", "es_permuted", "es_permuted_kinds",
        "soft_hybrid", "map_soft_hybrid",
    )},
}  # fmt: skip
WHOM = ("make repro", "DVC", "a stage", "a worker")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
#: Seconds in which a run that was struck must end, or be done; and in which all that it began must be gone.
MOST, GONE = 600, 30
#: Raised where a process has ended meanwhile.
ENDED = (psutil.Error, OSError)
#: What ``make repro`` calls.
REPRO = [sys.executable, str(Path(workspace.__file__).with_name("repro.py"))]


@dataclass(frozen=True)
class Fault:
    """What was done to a run, and where it was by then."""

    whom: str
    how: str
    #: the stage that ran
    stage: str
    #: exit status of the run, which may have got over it
    status: int
    #: what was lost by it
    lost: str = ""


class Lost(Exception):
    """A fault that was not survived: what differs, stays or fails."""


class Workspace:
    """A small pipeline, or some stages of it, and the digests of what an undisturbed run makes.

    Each run starts from nothing, or from the outputs of earlier stages in some folders of ``data``.
    """

    def __init__(self, folder: Path, targets: Sequence[str] = (), inputs: Sequence[str] = ()) -> None:
        workspace.make(folder, SMALL)
        self.folder, self.targets, self.inputs, self.expected = folder, targets, inputs, dict[str, str]()

    def begin(self, limit: int | None = None) -> subprocess.Popen[str]:
        """A run, in a session of its own, whose files may not grow beyond a limit in bytes."""
        return subprocess.Popen(
            [*REPRO, *self.targets], cwd=self.folder, env=ENVIRONMENT, start_new_session=True, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            preexec_fn=partial(_prepare, os.getpid(), limit),
        )  # fmt: skip

    def finish(self) -> float:
        """Run what is left to run; how long that takes.

        Raises:
            Lost: where it fails, or leaves a process.
        """
        start = time.monotonic()
        run = self.begin()
        _, err = run.communicate()
        if run.returncode:
            raise Lost(f"the next run fails: {' '.join(err.split())[-300:]}")
        _nobody_left(run.pid)
        return time.monotonic() - start

    def compare(self) -> None:
        """See that what was made is what was expected.

        Raises:
            Lost: where anything differs, lacks or is left over.
        """
        made = self.digests()
        differs = sorted(name for name in made.keys() | self.expected if made.get(name) != self.expected.get(name))
        if differs:
            raise Lost(f"{len(differs)} files differ, lack or stay: {', '.join(differs[:5])}")

    def digests(self) -> dict[str, str]:
        """SHA-256 of everything that a run has made: data, reports and the lock file."""
        made = [path for part in ("data", "reports") for path in (self.folder / part).rglob("*") if path.is_file()]
        files = [path for path in made if not path.is_relative_to(self.folder / "data/raw")]
        files.append(self.folder / "dvc.lock")
        return {str(path.relative_to(self.folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}

    def clear(self) -> None:
        """Remove what runs have made, but for their inputs; DVC keeps its locks and notes."""
        outputs = [path for path in (self.folder / "data").iterdir() if path.name not in ("raw", *self.inputs)]
        for path in [*outputs, self.folder / ".dvc/cache", self.folder / "reports"]:
            shutil.rmtree(path, ignore_errors=True)
        if not self.inputs:
            (self.folder / "dvc.lock").unlink(missing_ok=True)

    def strike(
        self, whom: str, how: signal.Signals, after: float, chosen: random.Random, running: str = ""
    ) -> Fault | None:
        """Start a run, and signal a process of it some seconds later; null where the run had ended.

        Args:
            running: a kind of process that has to run by then (the one that is signalled).

        Raises:
            Lost: where the run does not end, or leaves a process.
        """
        run = self.begin()
        with _ended(run):
            time.sleep(after)
            while not _victims(run.pid, running or whom) and run.poll() is None:
                time.sleep(0.02)
            if not (victims := _victims(run.pid, whom)):
                return None
            stage = _stage_of(run.pid)
            with suppress(*ENDED):
                chosen.choice(victims).send_signal(how)
            try:
                run.communicate(timeout=MOST)
            except subprocess.TimeoutExpired as error:
                raise Lost(f"the run never ends, in {stage}") from error
            _nobody_left(run.pid)
            return Fault(whom, how.name, stage, run.returncode)

    def starve(self, limit: int | None = None) -> Fault:
        """A run that finds no room: on its disk, or because its files may not grow beyond a limit in bytes.

        Raises:
            Lost: where it ends well, in a traceback, or leaves a process.
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
        how = "full" if limit is None else "files of some KiB at most"
        return Fault("the disk", how, stage, run.returncode)


def _prepare(parent: int, limit: int | None) -> None:
    """It ends with the test, and Ctrl-C counts, though whoever runs the test may have wanted it ignored."""
    tie_to_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


@contextmanager
def _ended(run: subprocess.Popen[str]) -> Iterator[None]:
    """Nothing of a run stays, whatever becomes of the test."""
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
    """Processes of the session that a process leads, those too that are dead and that nobody has taken note of yet.

    DVC takes these for alive, and their lock for theirs.
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
    """The run itself, DVC, the stage that it runs, or that one's workers."""
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
