"""Arguments of the library as what they must be: lists, texts, mappings, arrays; a mistake is an ``InputError``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from isi.base import paths
from isi.base.errors import InputError, short


@contextmanager
def argument(name: str) -> Iterator[None]:
    """Mistakes that are said of ``params.yaml``, said of an argument."""
    try:
        yield
    except InputError as error:
        file, place, expected = error.args
        if file != str(paths.PARAMS):
            raise
        within = re.sub(rf"{name}s?(\.|$)", "", place, count=1) if place.startswith(name) else place
        raise InputError(f"argument {name!r}", within, expected) from error


def listed(values: Any, name: str, of: str) -> list[Any]:
    """What an argument lists.

    Raises:
        InputError: where it is no list, or a text, whose letters nobody means.
    """
    try:
        each = iter(values)
    except TypeError as error:
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got {short(values)}") from error
    if isinstance(values, str | bytes):
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got one text")
    return list(each)


def texts(values: Any, name: str) -> list[str]:
    """Names that an argument lists.

    Raises:
        InputError: where one is no text.
    """
    found = listed(values, name, "names")
    wrong = [value for value in found if not isinstance(value, str)]
    if wrong:
        raise InputError(f"argument {name!r}", "", f"expected texts, got {short(wrong[0])}")
    return found


def name_of(value: Any, name: str) -> str | None:
    """The name that an argument gives; null where it gives none.

    Raises:
        InputError: where it is no text.
    """
    if value is not None and not isinstance(value, str):
        raise InputError(f"argument {name!r}", "", f"expected a name, got {short(value)}")
    return value


def mapping(values: Any, name: str) -> dict[str, Any]:
    """What an argument gives by name; nothing where it is null.

    Raises:
        InputError: where it is no mapping.
    """
    if values is not None and not isinstance(values, Mapping):
        raise InputError(f"argument {name!r}", "", f"expected a mapping of names to values, got {short(values)}")
    return dict(values or {})


def array(values: Any, place: str, expected: str, dtype: type[np.floating[Any]] | None = None) -> np.ndarray:
    """Values as an array.

    Raises:
        InputError: where they are none: texts, rows of several lengths, a tensor that learns or lies on a GPU.
    """
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:  # RuntimeError: of a tensor
        raise InputError(place, "", f"{expected} ({error})") from error
