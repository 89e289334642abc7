"""Names as people type them: as they are written, else without regard to case and gaps (``turnOn``, ``turn on``)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches

from isi.base.errors import InputError

#: Names that are suggested, at most, and listed where none is near.
SUGGESTED, LISTED = 3, 8
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_GAPS = re.compile(r"[\s_-]+")


def plain(name: str) -> str:
    """A name without what people type one way or another: ``hasAffordance`` and ``has affordance`` are the same."""
    return _GAPS.sub(" ", _HUMP.sub(" ", name)).strip().casefold()


def alike(one: str, other: str) -> bool:
    """Whether two names differ in no more than case and gaps."""
    return plain(one).replace(" ", "") == plain(other).replace(" ", "")


def find(text: str, ids: Mapping[str, int], place: str, what: str) -> int:
    """The id of a name.

    Args:
        place: where it was typed.
        what: it is to be the name of.

    Raises:
        InputError: where there is none, saying which was meant, probably; or where several could be.
    """
    if text in ids:
        return ids[text]
    same = [name for name in ids if alike(name, text)]
    if len(same) == 1:
        return ids[same[0]]
    if same:
        raise InputError(place, "", f"expected {what} as it is written: {listed(same)}; got {text!r:.80}")
    raise InputError(place, "", f"expected {what}, got {text!r:.80}{_meant(text, list(ids))}")


def _meant(text: str, names: Sequence[str]) -> str:
    """What was meant, as a question; of few names, which there are."""
    by_plain = {plain(name): name for name in names}
    wanted = plain(text)
    near = get_close_matches(wanted, by_plain, SUGGESTED) or [name for name in by_plain if wanted and wanted in name]
    if near:
        return f" (did you mean {listed([by_plain[name] for name in near[:SUGGESTED]], ' or ')}?)"
    return f" (there are {listed(names)})" if 0 < len(names) <= LISTED else ""


def listed(names: Sequence[str], between: str = ", ") -> str:
    """Names, quoted; not all where they are many."""
    more = [f"{len(names) - LISTED} more"] * (len(names) > LISTED)
    return between.join([*(repr(name) for name in names[:LISTED]), *more])
