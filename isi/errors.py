"""Errors in a user's input, in one line: file, place in it, value found, value expected, remedy."""

import errno
import os
import re
import reprlib
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import ValidationError

LONGEST = 270  #: Maximum number of characters of a message; a longer one loses its middle.
NO_SUCH_FILE = "no such file"  #: The message for a missing file.
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


class InputError(Exception):
    """An error in the user's input: the file, the place in it,
    and a message (value found and value expected).
    """

    def __init__(self, file: object, place: object, message: str) -> None:
        super().__init__(str(file), str(place), message)
        self.file, self.place, self.message = str(file), str(place), message

    def __str__(self) -> str:
        # no line ends or tabs
        line = cut(" ".join(": ".join(filter(None, self.args)).split()), LONGEST)
        return cut("".join(c if c.isprintable() else ascii(c)[1:-1] for c in line), LONGEST)


class MissingPackage(InputError, ImportError):
    """A package that is not installed; the message names the extra of this
    project that installs it.
    """


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports inside need this extra of ``isi-kge``;
    ``MissingPackage`` where a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        raise MissingPackage(
            f"package {package}", "", f"not installed: pip install 'isi-kge[{name}]'"
        ) from error


def is_of_pyarrow(error: Exception) -> bool:
    """Whether pyarrow raised an error; pyarrow, which few commands need,
    is not imported for that.
    """
    return type(error).__module__.split(".")[0] == "pyarrow"


@contextmanager
def at(file: object, place: object = "") -> Iterator[None]:
    """Turn an error raised inside (InputError, pydantic, pyarrow, UTF-8, system) into an
    InputError with file, place::

        with at("log.csv", "line 3"):  # log.csv: line 3, column 'head': expected a name, got ''
            raise InputError("", "column 'head'", f"expected a name, got {short(row[0])}")

    If the error names another file, its whole text becomes the message.
    """
    try:
        yield
    except Exception as error:
        inner, message = _place_and_message(error, str(file))
        keys = all(re.fullmatch(r"[\w.]+", str(part)) for part in (place, inner))
        places = ("." if keys else ", ").join(filter(None, map(str, (place, inner))))
        raise InputError(file, places, message) from error


def _place_and_message(error: Exception, file: str) -> tuple[str, str]:
    match error:
        case InputError():
            return (error.place, error.message) if error.file in ("", file) else ("", str(error))
        case UnicodeDecodeError():
            return (
                "",
                (
                    f"expected UTF-8, got byte 0x{error.object[error.start]:02x} "
                    f"at position {error.start + 1:,}"
                ),
            )
        case ValidationError():
            return _first_mistake(error)
        case OSError():
            return "", f"cannot be read ({os_message(error)})"
    if is_of_pyarrow(error):
        return "", f"cannot be read ({cut(str(error), 120)})"
    raise error


def _first_mistake(error: ValidationError) -> tuple[str, str]:
    """Place and text of an error (unknown keys and non-lists before others),
    with the number of further errors.
    """
    first: Any = min(
        error.errors(), key=lambda mistake: mistake["type"] not in ("unknown_key", "list_type")
    )
    kind, got, context = first["type"], first["input"], first.get("ctx", {})
    loc = [*first["loc"], *([context["key"]] if kind == "unknown_key" else [])]
    # not the types of a union
    place = ".".join(str(part) for part in loc if not re.search(r"[\[\]()]", str(part)))
    message = first["msg"].removeprefix("Value error, ")
    if kind == "list_type" and isinstance(got, str):
        message = f"expected a list, got the text {short(got)}: write [{cut(got, 60)}]"
    elif kind not in ("missing", "value_error", "unknown_key", "json_invalid"):
        message += f", got {short(got)}"
    if kind == "literal_error":
        message += suggestion(got, re.findall("'([^']+)'", context["expected"]))
    return place, message + f" (and {error.error_count() - 1} more)" * (error.error_count() > 1)


def unwritable(path: Path, error: OSError) -> InputError:
    """An ``InputError`` that says why a file cannot be written,
    with the free space if the disk is full.
    """
    why = "its folder is a file" if error.errno == errno.EEXIST else os_message(error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        with suppress(OSError, StopIteration):
            free = shutil.disk_usage(
                next(folder for folder in path.absolute().parents if folder.is_dir())
            ).free
            why += f"; {free / 2**20:.1f} MiB free there"
    return InputError(path, "", f"cannot be written ({why})")


def os_message(error: OSError) -> str:
    """The text of a system error, without the file's name."""
    return os.strerror(error.errno) if error.errno else str(error) or type(error).__name__


def short(value: object) -> str:
    """The ``repr`` of a value, shortened where it is long or deeply nested."""
    try:
        return cut(_SHORT.repr(value), 100)
    except ValueError:  # Python does not print integers of more than 4,300 digits
        return "a number of thousands of digits"


def cut(text: str, most: int = 80) -> str:
    """Shorten a text to at most ``most`` characters: ``...`` replaces its middle."""
    behind = max(0, most - 3) // 3
    return (
        text
        if len(text) <= most
        else f"{text[: max(0, most - 3 - behind)]}...{text[len(text) - behind :]}"
    )


def suggestion(name: object, known: Iterable[object]) -> str:
    """``; did you mean ...`` with the known name nearest to a misspelt one, in any case,
    or an empty text.
    """
    folded = {str(other).casefold(): str(other) for other in known}
    close = get_close_matches(str(name)[:LONGEST].casefold(), folded, 1)
    return f"; did you mean {folded[close[0]]!r}?" if close else ""
