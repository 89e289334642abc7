"""A process that reads files within limits:
2 GiB of additional memory, and ten seconds of its own CPU time.
"""

import multiprocessing
import resource
import signal
import tempfile
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import chdir
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self

import torch

from isi.errors import InputError
from tools.fuzz.formats import Files, Format

MEMORY = 2 * 2**30
SECONDS = 10
#: Seconds of wall time after which the process is killed, for processes that use no CPU time.
PATIENCE = 120
#: Modules imported before the memory limit is set, since their memory does not depend on the files.
PRELOADED = [
    "tools.fuzz.worker",
    "gensim.models",
    "safetensors.torch",
    "rdflib.plugins.parsers.notation3",
]
LONGEST = 300  #: Maximum number of characters in a line of refusal.
EARLIER = b"the last good one"  #: What is in an output before.


@dataclass(frozen=True)
class Outcome:
    """The outcome of reading some files."""

    kind: Literal["read", "refused", "fault"]
    #: the line of refusal, the traceback, or a description of another fault
    problem: str = ""
    #: a text that is equal for files with equal content
    meaning: str = ""
    seconds: float = 0.0
    mib: int = 0
    #: what was read, of a fault
    files: Files = field(default_factory=dict)


def attempt(form: Format, files: Files, seconds: float) -> Outcome:
    """Read files in a temporary folder as a stage does,
    and check the message and the files that are left.
    """
    signal.setitimer(signal.ITIMER_PROF, seconds)  # ends the process, even in a loop of C
    signal.alarm(PATIENCE)
    start = time.process_time()
    with tempfile.TemporaryDirectory(prefix="isi-fuzz-") as folder, chdir(folder):
        for path, content in (files | {str(path): EARLIER for path in form.writes}).items():
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_bytes(content)
        outcome = _read(form, files)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.alarm(0)
    mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return replace(outcome, seconds=time.process_time() - start, mib=mib)


def _read(form: Format, files: Files) -> Outcome:
    line, faults = "", list[str]()
    try:
        outcome = Outcome("read", meaning=form.read())
    except InputError as error:
        line = str(error)
        outcome = Outcome("refused", line)
        if not line.isprintable():
            faults.append(f"not printable: {line!r}")
        if len(line) > LONGEST:
            faults.append(f"{len(line)} characters: {line}")
        if any(path.read_bytes() != EARLIER for path in form.writes):
            faults.append(f"an output was touched: {line}")
    except Exception:
        return Outcome("fault", traceback.format_exc(limit=-12))
    present = {str(path) for path in Path().rglob("*") if path.is_file()}
    if left := present - files.keys() - set(map(str, form.writes)):
        faults.append(f"files are left: {sorted(left)}")
    return Outcome("fault", "; ".join(faults)) if faults else outcome


def _limit() -> None:
    torch.set_num_threads(1)  # on a busy machine, threads that wait for each other use up the time
    status = Path("/proc/self/statm")
    if status.exists():
        size = int(status.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Worker:
    """Reads files in another process, and starts a new process when one dies."""

    def __init__(self, seconds: float = SECONDS) -> None:
        self._seconds = seconds

    def __enter__(self) -> Self:
        context: Any = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOADED)
        self._pool = ProcessPoolExecutor(1, context, _limit)
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def read(self, form: Format, files: Files) -> Outcome:
        """The outcome of reading files of a format."""
        try:
            outcome = self._pool.submit(attempt, form, files, self._seconds).result()
        except BrokenProcessPool:
            self.__enter__()
            problem = f"the process died: a crash, or more than {self._seconds:g} s"
            outcome = Outcome("fault", problem)
        return replace(outcome, files=files) if outcome.kind == "fault" else outcome
