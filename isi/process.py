"""How processes end: none outlives the one that started it, and one that is told to stop does so in one line.

What every command does around its work: whatever ends it early ends it with one line, and with its own status.
"""

from __future__ import annotations

import argparse
import ctypes
import errno
import fcntl
import io
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from isi import pipeline
from isi.errors import InputError, cut, system_says, unwritable

_PR_SET_PDEATHSIG = 1
#: By Ctrl-C, and by ``kill``, ``timeout`` or a scheduler.
STOPPING = (signal.SIGINT, signal.SIGTERM)


def tie_to_parent(parent: int | None = None) -> None:
    """End this process when the one that started it ends, however that ends.

    Linux signals it at once (``PR_SET_PDEATHSIG``); elsewhere a thread looks twice a second.

    Args:
        parent: process id of the parent, where known: it may have ended before this call.
    """
    parent = parent or os.getppid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before the call
            os._exit(1)
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def lives(process: str) -> bool:
    """Whether there is another process of that id on this machine."""
    try:
        os.kill(int(process), 0)
    except (ValueError, ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # someone else's
        return True
    return int(process) != os.getpid()


def serve(parent: int) -> None:
    """Make this process a worker: it ends with its parent, whom alone Ctrl-C concerns."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    tie_to_parent(parent)


def stop_in_one_line(name: str, then: str = "run it again") -> None:
    """Have Ctrl-C and SIGTERM end this process with one line and the status that shells give such an end.

    What is under way is left as by any exception, so that temporary files go; a second signal ends it at once. A signal
    that whoever started the process wants ignored stays so.

    Args:
        name: of the command.
        then: what goes on from here.
    """
    own = os.getpid()

    def stop(number: int, _: FrameType | None) -> None:
        for one in STOPPING:
            signal.signal(one, signal.SIG_DFL)
        if os.getpid() == own:  # not a worker that has just been forked
            said = f"{name}: stopped by {signal.Signals(number).name}; no file is half-written; {then}\n"
            os.write(2, b"\n" * os.isatty(2) + said.encode())  # below a bar; and print may be what was interrupted
            raise SystemExit(128 + number)
        os._exit(128 + number)

    for one in STOPPING:
        if signal.getsignal(one) is not signal.SIG_IGN:
            signal.signal(one, stop)


@contextmanager
def stoppable(name: str, then: str = "run it again") -> Iterator[None]:
    """``stop_in_one_line`` for as long as some work lasts."""
    before = {one: signal.getsignal(one) for one in STOPPING}
    stop_in_one_line(name, then)
    try:
        yield
    finally:
        for one, handler in before.items():
            if signal.getsignal(one) is not signal.SIG_DFL:  # a second signal is to end what a first one interrupted
                signal.signal(one, handler)


#: Where DVC keeps what is no output, and git looks away.
LOCKS = Path(".dvc") / "tmp"


class Parser(argparse.ArgumentParser):
    """Answers mistakes in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {cut(' '.join(message.split()), 200)}; see --help\n")


@contextmanager
def one_line(name: str, then: str = "run it again") -> Iterator[None]:
    """End the process with one line on what its user did wrong, or what stands in the way: a disk, a signal.

    Args:
        name: of the command.
        then: what goes on from where a signal has stopped it.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names may be of letters that a terminal lacks
    with stoppable(name, then):
        try:
            yield
            _flush()
        except InputError as error:
            sys.exit(f"{name}: {error}")
        except BrokenPipeError:  # who read what we print has enough
            _drop_output()
            sys.exit(141)
        except OSError as error:
            gone = isinstance(error, FileNotFoundError) and isinstance(error.filename, str)
            sys.exit(f"{name}: {pipeline.absent(Path(error.filename)) if gone else _reason(error)}")
        except MemoryError:
            sys.exit(f"{name}: not enough memory: lower compute.workers or compute.stack in params.yaml, or its input")


def _reason(error: OSError) -> InputError:
    """What the system says, and of which file."""
    nameless = "standard output, or memory that processes share" if error.errno == errno.ENOSPC else ""
    named = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else nameless
    return InputError(named, "", system_says(error))


def _flush() -> None:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        _drop_output()
        raise InputError("standard output", "", f"cannot be written ({error.strerror})") from error


def _drop_output() -> None:
    """Let nothing more be written, which Python would try at its end."""
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


@contextmanager
def only_one(name: str) -> Iterator[None]:
    """Hold a name for as long as some work lasts, so that no second process does the same in this folder.

    The system lets go of it when the process ends, however that ends: the file that stays is in nobody's way. Where
    there is no ``.dvc``, or the file system knows no locks, nothing is held.

    Raises:
        InputError: where another process holds it.
    """
    if not LOCKS.parent.is_dir():
        yield
        return
    path = LOCKS / cut("isi." + re.sub(r"[^\w@.-]", "_", name), 100)
    try:
        LOCKS.mkdir(exist_ok=True)
        file = path.open("a+", encoding="ascii")
    except OSError as error:
        raise unwritable(path, error) from error
    with file:
        if not _locked(file.fileno()):
            file.seek(0)
            holder = file.read(20).strip() or "unknown"
            raise InputError("", "", f"{name} runs already in this folder (process {holder}): let it end, or stop it")
        file.truncate(0)
        try:
            print(os.getpid(), file=file, flush=True)
        except OSError as error:
            raise unwritable(path, error) from error
        yield


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # no locks here
        return True
    return True
