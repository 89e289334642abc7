"""Arguments by names of before, which still work, with a warning."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def renamed(**names: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """A decorator for a function that also takes arguments by names of before; ``names`` maps each
    of these to the name of now. They warn with a ``DeprecationWarning``.

    Example:
        >>> import warnings
        >>> from isi.renamed import renamed
        >>> @renamed(size="number")
        ... def take(number: int = 1) -> int:
        ...     return number
        >>> with warnings.catch_warnings(action="ignore"):
        ...     take(size=3)
        3
    """

    def decorated(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def called(*args: Any, **given: Any) -> T:
            for before in [name for name in names if name in given]:
                now = names[before]
                if now in given:
                    both = f"{before!r} and {now!r}, which are the same argument"
                    raise TypeError(f"{function.__name__}() got {both}")
                message = f"argument {before!r} of {function.__name__} is now {now!r}"
                warnings.warn(message, DeprecationWarning, stacklevel=2)
                given[now] = given.pop(before)
            return function(*args, **given)

        return called

    return decorated


def warn_of(before: str, now: str, stacklevel: int = 3) -> None:
    """Warn the caller of a deprecated function, and say what to type instead of it."""
    warnings.warn(f"{before} is now {now}", DeprecationWarning, stacklevel=stacklevel)
