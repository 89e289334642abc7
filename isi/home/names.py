"""Names of new entities, and lists of kinds, beside the known names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import AfterValidator

from isi.config import check
from isi.errors import InputError
from isi.graph.vocabulary import SUGGESTED, Vocabulary, numbers
from isi.names import check_name

NewName = Annotated[str, AfterValidator(check_name)]


def check_new(name: str, known: Vocabulary, like: str | None, new: bool) -> None:
    """InputError for a known name, and (unless ``new``) for one that resembles a known name.

    ``like``: the known name with the most similar words, if they are very similar.
    """
    check(name, NewName, "", "name")
    if (same := known.same(name)) is not None:
        raise InputError(
            repr(name)[:80], "", f"expected a new name: {same!r:.80} is known; use observe"
        )
    if new:
        return
    near = known.resembled(name)
    if near is None and like is not None and numbers(like) == numbers(name):
        near = like
    if near is not None:
        expected = f"{near!r:.80} is known: use observe, or insert it as new (new=True, --new)"
        raise InputError(repr(name)[:80], "", expected)


def by_known_name(values: Mapping[str, str], known: Vocabulary) -> tuple[dict[str, str], list[str]]:
    """Values by the known name that theirs is (``Vocabulary.same``), and the names of the others:
    of several for one name, the one that is written as the name, or else the first, counts.
    """
    matched = {name: value for name, value in values.items() if name in known.ids}
    missing = list[str]()
    for name, value in values.items():
        same = known.same(name)
        if same is None or (same != name and same in matched):
            missing.append(name)
        else:
            matched[same] = value
    return matched, missing


def note_of_kinds(
    missing: Sequence[str], listed: int, without: Sequence[str], known: Vocabulary
) -> str:
    """A sentence about listed names that match no entity, and entities without a kind;
    empty if there are none.
    """
    parts = []
    if missing:
        meant = [known.meant(name) for name in missing[:SUGGESTED]]
        known_meant = [name for name in meant if name is not None]
        hint = f"; did you mean {_first(known_meant)}?" if known_meant else ""
        parts.append(
            f"{len(missing):,} of {listed:,} names match no entity ({_first(missing)}{hint})"
        )
    if without:
        number = f"{len(without):,} of {known.number:,}"
        parts.append(f"{number} entities have no kind ({_first(without)})")
    return "; ".join(parts)


def _first(names: Sequence[str]) -> str:
    return ", ".join(f"{name!r:.80}" for name in names[:SUGGESTED]) + ", ..." * (
        len(names) > SUGGESTED
    )
