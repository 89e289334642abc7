"""What stands in the way of a command, said in one line."""

from __future__ import annotations

import errno
import os
import reprlib
import shutil
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

#: Characters of a message, at most: what is longer repeats the input, and is cut.
LONGEST = 270
_GIB, _MIB = 2**30, 2**20

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


class InputError(Exception):
    """A mistake in what the user supplied: names the file, the place in it, and what was expected."""

    def __init__(self, file: object, place: str, expected: str) -> None:
        super().__init__(str(file), place, expected)

    def __str__(self) -> str:
        parts = [_printable(part) for part in self.args if part]
        room = LONGEST - len(": ") * (len(parts) - 1)
        for number, place in enumerate(sorted(range(len(parts)), key=lambda place: len(parts[place]))):
            parts[place] = cut(parts[place], room // (len(parts) - number))  # the shorter leave room for the longer
            room -= len(parts[place])
        return ": ".join(parts)


class Unwritable(OSError):
    """An output that cannot be written: names it, why, and how much room there is, where that is why."""

    def __init__(self, path: Path, error: OSError) -> None:
        said = os.strerror(error.errno) if error.errno else str(error)
        why = "its folder is a file" if error.errno == errno.EEXIST else said
        super().__init__(error.errno, why + _room(path, error), str(path))

    def __str__(self) -> str:
        return str(InputError(self.filename, "", f"cannot be written ({self.strerror})"))


def _room(path: Path, error: OSError) -> str:
    if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return ""
    folder = next((one for one in path.absolute().parents if one.is_dir()), None)
    try:
        free = shutil.disk_usage(folder).free if folder else None
    except OSError:
        free = None
    if free is None:
        return ""
    return f"; {free / _GIB:.1f} GiB free there" if free >= _GIB else f"; {free / _MIB:.1f} MiB free there"


class NotAsWritten(InputError):
    """A file that by itself is not what its stage has written: it breaks a rule, or was edited."""


def short(value: object) -> str:
    """A value as a message repeats it: as Python writes it, but cut where it is long or deep."""
    try:
        return cut(_SHORT.repr(value), 100)
    except ValueError:  # Python writes no number of more than 4,300 digits
        return "a number of thousands of digits"


def cut(text: str, most: int = 80) -> str:
    """A text of at most so many characters, without its middle where it has more."""
    if len(text) <= most:
        return text
    behind = max(0, most - 3) // 3
    return f"{text[: max(0, most - 3 - behind)]}...{text[len(text) - behind :]}"


def closest(name: object, known: Iterable[object]) -> str | None:
    """The one of some names that another is like; null where none is."""
    return next(iter(get_close_matches(str(name)[:LONGEST], map(str, known), 1)), None)


def meant(name: object, known: Iterable[object]) -> str:
    """What a misspelt name was probably to be, as the end of a message; empty where nothing is like it."""
    close = closest(name, known)
    return "" if close is None else f"; did you mean {close!r}?"


def reason(error: OSError) -> str:
    """What the system says about a file, in one line."""
    if isinstance(error, Unwritable):
        return str(error)
    nameless = "standard output, or memory that processes share" if error.errno == errno.ENOSPC else ""
    named = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else nameless
    return str(InputError(named, "", error.strerror or str(error) or type(error).__name__))


def _printable(text: str) -> str:
    """The same in one line, without what would move a terminal's cursor."""
    kept = cut(text, 10 * LONGEST)  # of a text of megabytes, no more is looked at
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(kept.split()))
