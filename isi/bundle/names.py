"""Names as a user types them: as written, else without regard to case and gaps (``turnOn`` is ``turn on``)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches

from isi.errors import InputError

#: Names that are suggested, at most, and that are listed where none is similar.
SUGGESTED, LISTED = 3, 8
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_GAPS = re.compile(r"[\s_-]+")


def plain(name: str) -> str:
    """A name in lower-case words: ``hasAffordance`` and ``has_affordance`` are ``has affordance``."""
    return _GAPS.sub(" ", _HUMP.sub(" ", name)).strip().casefold()


def same_name(first: str, second: str) -> bool:
    """Whether two names differ in no more than case and gaps."""
    return plain(first).replace(" ", "") == plain(second).replace(" ", "")


def find(text: str, ids: Mapping[str, int], place: str, what: str) -> int:
    """The id of a name.

    Args:
        place: where it was typed.
        what: the name of what is expected, for the message.

    Raises:
        InputError: where no name, or more than one, is the same.
    """
    if text in ids:
        return ids[text]
    same = [name for name in ids if same_name(name, text)]
    if len(same) == 1:
        return ids[same[0]]
    if same:
        raise InputError(place, "", f"expected {what} as it is written: {quoted_list(same)}; got {text!r:.80}")
    raise InputError(place, "", f"expected {what}, got {text!r:.80}{_suggestion(text, list(ids))}")


def _suggestion(text: str, names: Sequence[str]) -> str:
    """Similar names as a question; where there are none, all names if they are few."""
    by_plain = {plain(name): name for name in names}
    wanted = plain(text)
    similar = get_close_matches(wanted, by_plain, SUGGESTED) or [name for name in by_plain if wanted and wanted in name]
    if similar:
        return f" (did you mean {quoted_list([by_plain[name] for name in similar[:SUGGESTED]], ' or ')}?)"
    return f" (there are {quoted_list(names)})" if 0 < len(names) <= LISTED else ""


def quoted_list(names: Sequence[str], between: str = ", ") -> str:
    """Names, quoted; not all where they are many."""
    more = [f"{len(names) - LISTED} more"] * (len(names) > LISTED)
    return between.join([*(repr(name) for name in names[:LISTED]), *more])
