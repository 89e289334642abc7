"""How processes end: none outlives the one that started it, and one that is told to stop does so in one line."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

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
