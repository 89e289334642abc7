"""What was read, as a message quotes it: in one line, and no more than its beginning and end."""

from __future__ import annotations

import json
from pathlib import Path
from reprlib import Repr
from typing import Any

from isi.base.errors import InputError

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


def short(value: object) -> str:
    """The representation of a value, at most some sixty characters of a text and a hundred of all."""
    try:
        return cut(_SHORT.repr(value), 100)
    except ValueError:  # Python writes out no number of more than 4,300 digits
        return "a number of thousands of digits"


def cut(text: str, most: int = 80) -> str:
    """The beginning of a text as it is, but for control characters."""
    return printable(text if len(text) <= most else f"{text[: most - 3]}...")


def printable(text: str) -> str:
    """The beginning of what another library says, without control characters of the text that it says it of."""
    return "".join(character if character.isprintable() else "?" for character in text[:120])


def json_of(path: Path, place: str, content: bytes | str) -> Any:
    """What JSON holds, of UTF-8 with a byte order mark or without.

    Raises:
        InputError: where it is broken, too deep for Python, or has a number that is too long for it.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(path, place, f"expected JSON: {error}") from error
    except UnicodeDecodeError as error:
        raise InputError(path, place, f"expected JSON: no UTF-8 ({error})") from error
    except RecursionError as error:
        raise InputError(path, place, "expected JSON: lists and mappings are too deep in each other") from error
    except ValueError as error:
        raise InputError(path, place, "expected JSON: a number has more than 4,300 digits") from error
