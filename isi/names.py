"""The rule for names: of entities, relations, kinds, rooms and phrases, in files,
arguments and bundles.
"""

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

from isi.errors import cut, short

LONGEST = 1000  #: Maximum number of characters of a name.
#: Unicode categories of refused characters: control characters, surrogates, line and paragraph
#: separators.
CONTROL = frozenset({"Cc", "Cs", "Zl", "Zp"})
#: Characters that show nothing: soft hyphens, spaces without width, marks of the writing direction.
#: Joiners (U+200C, U+200D) are not among them: they change letters of Persian and Hindi, and make
#: one emoji of several.
INVISIBLE = re.compile(r"[\u00ad\u061c\u180e\u200b\u200e\u200f\u202a-\u202e\u2060-\u206f\ufeff]")
#: Spaces of other widths, and those at which no line breaks.
SPACE = re.compile(r"[\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000]")


def check_text(text: str) -> str:
    """Return a text without control characters and line breaks; ``ValueError`` for any other."""
    if not text.isprintable() and any(unicodedata.category(letter) in CONTROL for letter in text):
        expected = "expected text without tabs, line breaks or other control characters"
        raise ValueError(f"{expected}, got {text[:80]!r}")
    return text


def clean(name: str) -> str:
    """The form in which names are read and compared:
    Unicode's NFC, without invisible characters and outer spaces.

    Spaces of other widths become plain ones. Names are equal if these forms are.
    """
    if not name.isascii():
        name = SPACE.sub(" ", INVISIBLE.sub("", unicodedata.normalize("NFC", name)))
    return name.strip(" ")


@lru_cache(2**16)
def plain(name: str) -> str:
    """A name as lower-case words: ``hasAffordance`` and ``has_affordance`` → ``has affordance``."""
    return " ".join(re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[_-]", " ", clean(name)).split()).casefold()


def name_fault(name: object) -> str | None:
    """The message of the error for an invalid name;
    None for a valid one, perhaps one that ``clean`` changes.
    """
    if not isinstance(name, str) or not name:
        return f"expected a name, got {short(name) if name else 'none'}"
    if len(name) > LONGEST:
        return (
            f"expected a name of at most {LONGEST:,} characters, got {len(name):,}: {short(name)}"
        )
    try:
        check_text(name)
    except ValueError:
        return (
            "expected a name without tabs, line breaks or other control characters, "
            f"got {short(name)}"
        )
    return None if clean(name) else f"expected a name, got nothing but spaces: {short(name)}"


def first_of(names: Sequence[str], most: int = 3) -> str:
    """The first names, and the number of the others: ``mug, cup, pan and 5 more``."""
    more = f" and {len(names) - most:,} more" * (len(names) > most)
    return ", ".join(cut(name, 40) for name in names[:most]) + more


def check_name(name: str) -> str:
    """Return a valid name unchanged; ``ValueError`` for any other (``name_fault``)."""
    if fault := name_fault(name):
        raise ValueError(fault)
    return name
