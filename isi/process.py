"""Ends of processes: no worker outlives its parent;
a command that fails or is stopped prints one line. And settings of a process, which threads share.
"""

import argparse
import ctypes
import errno
import io
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from types import FrameType
from typing import NoReturn

from isi.errors import NO_SUCH_FILE, InputError, cut, os_message

_PR_SET_PDEATHSIG = 1
#: Sent by Ctrl-C, and by ``kill``, ``timeout`` or a scheduler.
STOPPING = (signal.SIGINT, signal.SIGTERM)


def tie_to_parent(parent: int | None = None) -> None:
    """Kill this process when its parent ends: by a signal on Linux,
    elsewhere by polling every 0.5 s.
    """
    parent = parent or os.getppid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent ended before the call
            os._exit(1)
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


class Shared:
    """Settings of the process while any thread is inside: the first one enters ``context``, and the
    last one leaves it. Threads that each enter one of their own may leave settings that none of
    them found.

    Example:
        >>> with quiet, quiet:
        ...     warnings.warn("not shown")
    """

    def __init__(self, context: Callable[[], AbstractContextManager[object]]) -> None:
        self._context, self._entered = context, ExitStack()
        self._lock, self._inside = threading.Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._entered.enter_context(self._context())
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._entered.close()


#: No warnings, for calls of libraries that warn of what is no fault here.
quiet = Shared(partial(warnings.catch_warnings, action="ignore"))


def is_running(process: str) -> bool:
    """Whether another process with this id runs on this machine."""
    try:
        with suppress(PermissionError):  # a process of another user
            os.kill(int(process), 0)
    except (ValueError, ProcessLookupError, OverflowError):
        return False
    return int(process) != os.getpid()


def become_worker(parent: int) -> None:
    """Make this process a worker: it ends with its parent and ignores Ctrl-C,
    which the parent handles.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    tie_to_parent(parent)


def handle_stop_signals(name: str, then: str = "run it again") -> None:
    """On Ctrl-C or SIGTERM print a line and raise ``SystemExit``, so that cleanup runs;
    a second signal kills.
    """
    process = os.getpid()

    def stop(number: int, _: FrameType | None) -> None:
        for stopping in STOPPING:
            signal.signal(stopping, signal.SIG_DFL)
        if os.getpid() != process:  # a worker that has just been forked
            os._exit(128 + number)
        line = (
            f"{name}: stopped by {signal.Signals(number).name}; no file is half-written; {then}\n"
        )
        os.write(2, b"\n" * os.isatty(2) + line.encode())  # print itself may have been interrupted
        raise SystemExit(128 + number)

    for stopping in STOPPING:
        if signal.getsignal(stopping) is not signal.SIG_IGN:
            signal.signal(stopping, stop)


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors take one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {cut(' '.join(message.split()), 200)}; see --help\n")


def open_descriptors() -> None:
    """Open the null device for standard input, output or error where it is closed, so that no file
    that is opened later takes its number; what is written to a closed output fails. A pipe that
    does not block would lose output.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            way = os.O_RDONLY if name == "stdout" else os.O_RDWR
            descriptor = os.open(os.devnull, way)  # the lowest number that is free
            os.set_inheritable(descriptor, True)
            setattr(sys, name, open(descriptor, "w" if number else "r"))  # noqa: PTH123, SIM115
        elif number:
            with suppress(OSError):
                os.set_blocking(number, True)


@contextmanager
def errors_in_one_line(name: str, then: str = "run it again") -> Iterator[None]:
    """Exit with one line on InputError, OSError (broken pipe: no line),
    MemoryError or a signal (advice: ``then``).
    """
    open_descriptors()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal may lack letters of a name
    before = {stopping: signal.getsignal(stopping) for stopping in STOPPING}
    handle_stop_signals(name, then)
    try:
        yield
        sys.stdout.flush()
    except InputError as error:
        sys.exit(f"{name}: {error}")
    except OSError as error:
        # discard the output that Python flushes at exit
        if isinstance(sys.stdout, io.TextIOWrapper):
            with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
                os.dup2(nowhere.fileno(), sys.stdout.fileno())
        sys.exit(141 if isinstance(error, BrokenPipeError) else f"{name}: {_of_system(error)}")
    except MemoryError:
        sys.exit(
            f"{name}: not enough memory: lower compute.workers or compute.stack in params.yaml, "
            "or use less input"
        )
    finally:
        for stopping, handler in before.items():
            if signal.getsignal(stopping) is not signal.SIG_DFL:  # a second signal must still kill
                signal.signal(stopping, handler)


def _of_system(error: OSError) -> InputError:
    if isinstance(error, FileNotFoundError) and isinstance(error.filename, str):
        return InputError(error.filename, "", NO_SUCH_FILE)
    full = "standard output or shared memory" if error.errno == errno.ENOSPC else ""
    return InputError(
        error.filename or full, "", f"cannot be written or read ({os_message(error)})"
    )
