"""A process that reads files within limits:
2 GiB of additional memory, and ten seconds of its own CPU time.
"""

import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import torch

from isi.errors import InputError
from tools.fuzz.faulty import FAULTY
from tools.fuzz.formats import FORMATS
from tools.fuzz.mutations import Files

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
#: Maximum number of characters in a line of refusal.
LONGEST = 300


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


def attempt(name: str, files: Files) -> Outcome:
    """Read files in a temporary folder as a stage does,
    and check the message and the files that are left.
    """
    start, home = time.process_time(), Path.cwd()
    with tempfile.TemporaryDirectory(prefix="isi-fuzz-") as folder:
        root = Path(folder).resolve()
        os.chdir(root)
        try:
            for path, content in files.items():
                Path(path).parent.mkdir(parents=True, exist_ok=True)
                Path(path).write_bytes(content)
            kind, problem, meaning = _read(name, set(files))
        finally:
            os.chdir(home)
    mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return Outcome(kind, problem, meaning, time.process_time() - start, mib)


def _read(name: str, given: set[str]) -> tuple[Literal["read", "refused", "fault"], str, str]:
    form = FORMATS.get(name) or FAULTY[name]
    earlier = b"the last good one"
    for path in form.writes:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_bytes(earlier)
    try:
        meaning = form.read()
        wrong = ""
    except InputError as error:
        meaning, line = "", str(error)
        wrong = _wrong_line(line)
        if any(Path(path).read_bytes() != earlier for path in form.writes):
            wrong = f"an output was touched: {line}"
    except Exception:
        return "fault", traceback.format_exc(limit=-12), ""
    else:
        line = ""
    left = (
        {str(path) for path in Path().rglob("*") if path.is_file()}
        - given
        - set(map(str, form.writes))
    )
    if left:
        wrong = f"files are left: {sorted(left)}"
    return (
        ("fault", wrong, "") if wrong else ("refused", line, "") if line else ("read", "", meaning)
    )


def _wrong_line(line: str) -> str:
    if not line.isprintable():
        return f"not printable: {line!r}"
    return f"{len(line)} characters: {line}" if len(line) > LONGEST else ""


def _serve(jobs: Connection, seconds: float) -> None:
    torch.set_num_threads(1)  # on a busy machine, threads that wait for each other use up the time
    status = Path("/proc/self/statm")
    has = int(status.read_text().split()[0]) * resource.getpagesize() if status.exists() else 0
    if has:
        resource.setrlimit(resource.RLIMIT_AS, (has + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    jobs.send("ready")
    while True:
        try:
            name, files = jobs.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_PROF, seconds)  # ends the process, even in a loop of C
        outcome = attempt(name, files)
        signal.setitimer(signal.ITIMER_PROF, 0)
        jobs.send(outcome)


class Worker:
    """Reads files in another process, and starts a new process when one dies."""

    def __init__(self, seconds: float = SECONDS) -> None:
        self._seconds = seconds

    def __enter__(self) -> Self:
        self._start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._end()

    def read(self, name: str, files: Files) -> Outcome:
        """The outcome of reading files of a format."""
        self._jobs.send((name, files))
        try:
            if self._jobs.poll(PATIENCE):
                outcome: Outcome = self._jobs.recv()
                return outcome
            died = f"no answer within {PATIENCE} s"
        except EOFError:
            self._process.join()
            status = self._process.exitcode or 0
            hung = status == -signal.SIGPROF
            died = (
                f"more than {self._seconds:g} s"
                if hung
                else f"the process ended with status {status}"
            )
        self._end()
        self._start()
        return Outcome("fault", died)

    def _start(self) -> None:
        context: Any = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOADED)
        self._jobs, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._seconds), daemon=True)
        self._process.start()
        theirs.close()
        if not self._jobs.poll(PATIENCE) or self._jobs.recv() != "ready":
            sys.exit("the process that reads cannot be started")

    def _end(self) -> None:
        self._jobs.close()
        self._process.kill()
        self._process.join()
