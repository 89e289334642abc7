"""Names as people type them: spellings that are the same, known names that a new one resembles, suggestions."""

import re
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import Annotated

from pydantic import AfterValidator

from isi.config import check
from isi.errors import InputError
from isi.names import check_name, clean

SUGGESTED, LISTED = 3, 8  #: Maximum number of names that a message suggests: similar ones; ``same_name`` or all names.
NewName = Annotated[str, AfterValidator(check_name)]


def check_new(name: str, known: Sequence[str], like: str | None, new: bool) -> None:
    """InputError for a known name, and (unless ``new``) for a plural or singular of one and for a name ``like`` one."""
    check(name, NewName, "", "name")
    if same := [other for other in known if same_name(other, name)]:
        raise InputError(repr(name)[:80], "", f"expected a new name: {same[0]!r:.80} is known; use observe")
    text, forms = plain(name), singulars(name)
    near = next((other for other in known if plain(other) in forms or text in singulars(other)), like)
    if near is not None and not new:
        expected = f"{near!r:.80} is known: use observe, or insert it as new (new=True, --new)"
        raise InputError(repr(name)[:80], "", expected)


@lru_cache(2**16)
def plain(name: str) -> str:
    """A name as lower-case words: ``hasAffordance`` and ``has_affordance`` → ``has affordance``."""
    return " ".join(re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[_-]", " ", clean(name)).split()).casefold()


def singulars(name: str) -> set[str]:
    """The plain form of a name, and what its last word may be the plural of."""
    text = plain(name)
    forms = {text} | ({text.removesuffix("s")} if len(text) > 3 and not text.endswith("ss") else set())
    endings = ("es", ""), ("ies", "y"), ("ves", "f"), ("ves", "fe")
    return forms | {text.removesuffix(ending) + instead for ending, instead in endings if text.endswith(ending)}


def same_name(first: str, second: str) -> bool:
    """Whether two names are equal up to case, spaces, hyphens, underscores, Unicode's forms, invisible characters."""
    return plain(first).replace(" ", "") == plain(second).replace(" ", "")


def find(text: str, names: Collection[str], place: str, expected: str) -> str:
    """The name that equals a text, or else the only ``same_name``; an ``InputError`` suggests similar names."""
    same = [text] if text in names else [name for name in names if same_name(name, text)]
    if len(same) == 1:
        return same[0]
    wanted, by_plain = plain(text), {plain(name): name for name in names}
    near = get_close_matches(wanted, by_plain, SUGGESTED) or [name for name in by_plain if wanted and wanted in name]
    close = same[:LISTED] or [by_plain[name] for name in near[:SUGGESTED]] or list(names) * (len(names) <= LISTED)
    hint = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
    raise InputError(place, "", f"expected {expected} of this embedding, got {text!r:.80}{hint}")
