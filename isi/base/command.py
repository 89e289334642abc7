"""What every command does around its work: whatever ends it early ends it with one line, and with its own status."""

from __future__ import annotations

import argparse
import fcntl
import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from isi.base import pipeline
from isi.base.errors import InputError, Unwritable, cut, reason
from isi.base.lifetime import stoppable

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
            sys.exit(f"{name}: {pipeline.absent(Path(error.filename)) if gone else reason(error)}")
        except MemoryError:
            sys.exit(f"{name}: not enough memory: lower compute.workers or compute.stack in params.yaml, or its input")


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
        raise Unwritable(path, error) from error
    with file:
        if not _locked(file.fileno()):
            file.seek(0)
            holder = file.read(20).strip() or "unknown"
            raise InputError("", "", f"{name} runs already in this folder (process {holder}): let it end, or stop it")
        file.truncate(0)
        try:
            print(os.getpid(), file=file, flush=True)
        except OSError as error:
            raise Unwritable(path, error) from error
        yield


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # no locks here
        return True
    return True
