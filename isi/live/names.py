"""Names as people type them: spellings that are the same, known names that a new one resembles,
suggestions.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated

from pydantic import AfterValidator

from isi.config import check
from isi.errors import InputError
from isi.names import bare, check_name, plain

#: Maximum number of names that a message suggests: similar ones; ``same_name`` or all names.
SUGGESTED, LISTED = 3, 8
NewName = Annotated[str, AfterValidator(check_name)]


def check_new(name: str, known: Sequence[str], like: str | None, new: bool) -> None:
    """InputError for a known name, and (unless ``new``) for a plural or singular of one
    and for a name ``like`` one.
    """
    check(name, NewName, "", "name")
    if same := [other for other in known if same_name(other, name)]:
        raise InputError(
            repr(name)[:80], "", f"expected a new name: {same[0]!r:.80} is known; use observe"
        )
    text, forms = plain(name), singulars(name)
    near = next(
        (other for other in known if plain(other) in forms or text in singulars(other)), like
    )
    if near is not None and not new:
        expected = f"{near!r:.80} is known: use observe, or insert it as new (new=True, --new)"
        raise InputError(repr(name)[:80], "", expected)


def singulars(name: str) -> set[str]:
    """The plain form of a name, and what its last word may be the plural of."""
    text = plain(name)
    forms = {text} | (
        {text.removesuffix("s")} if len(text) > 3 and not text.endswith("ss") else set()
    )
    endings = ("es", ""), ("ies", "y"), ("ves", "f"), ("ves", "fe")
    return forms | {
        text.removesuffix(ending) + instead for ending, instead in endings if text.endswith(ending)
    }


def same_name(first: str, second: str) -> bool:
    """Whether two names are equal up to case, spaces, hyphens, underscores, Unicode's forms,
    invisible characters.
    """
    return bare(first) == bare(second)


def known_as(text: str, names: Collection[str]) -> str | None:
    """The first of some names that is the same as a text (``same_name``), or None."""
    if text in names:
        return text
    return next((name for name in names if same_name(name, text)), None)


def find(text: str, names: Collection[str], place: str, expected: str) -> str:
    """The name that equals a text, or else the only ``same_name``;
    an ``InputError`` suggests similar names.
    """
    same = [text] if text in names else [name for name in names if same_name(name, text)]
    if len(same) == 1:
        return same[0]
    wanted, by_plain = plain(text), {plain(name): name for name in names}
    near = get_close_matches(wanted, by_plain, SUGGESTED) or [
        name for name in by_plain if wanted and wanted in name
    ]
    close = (
        same[:LISTED]
        or [by_plain[name] for name in near[:SUGGESTED]]
        or list(names) * (len(names) <= LISTED)
    )
    hint = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
    raise InputError(place, "", f"expected {expected} of this embedding, got {text!r:.80}{hint}")


def by_known_name(
    values: Mapping[str, str], known: Collection[str]
) -> tuple[dict[str, str], list[str]]:
    """Values by the known name that equals theirs, or else the only ``same_name``;
    and the names that match none.

    Names that are the same as several others match none.
    """
    exact = values.keys() & set(known)
    matched = {name: value for name, value in values.items() if name in exact}
    free = _by_bare(name for name in known if name not in exact)
    missing = list[str]()
    for form, names in _by_bare(name for name in values if name not in exact).items():
        candidates = free.get(form, [])
        if len(names) == len(candidates) == 1:
            matched[candidates[0]] = values[names[0]]
        else:
            missing += names
    return matched, missing


def _by_bare(names: Iterable[str]) -> dict[str, list[str]]:
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(bare(name), []).append(name)
    return groups


def note_of_kinds(
    missing: Sequence[str], listed: int, without: Sequence[str], entities: int
) -> str:
    """A sentence about listed names that match no entity, and entities without a kind;
    empty if there are none.
    """
    parts = []
    if missing:
        parts.append(f"{len(missing):,} of {listed:,} names match no entity ({_first(missing)})")
    if without:
        parts.append(f"{len(without):,} of {entities:,} entities have no kind ({_first(without)})")
    return "; ".join(parts)


def _first(names: Sequence[str]) -> str:
    return ", ".join(f"{name!r:.80}" for name in names[:SUGGESTED]) + ", ..." * (
        len(names) > SUGGESTED
    )
