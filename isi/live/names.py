"""Known names as people type them: which name a text is, which it may mean, suggestions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated

from pydantic import AfterValidator

from isi.config import check
from isi.errors import InputError
from isi.names import check_name, clean, loose, numbers, plain

#: Maximum number of names that a message suggests: similar ones, or all names.
SUGGESTED, LISTED = 3, 8
NewName = Annotated[str, AfterValidator(check_name)]


class KnownNames:
    """Known names, to be found by what was typed: in dictionaries, which are built when needed.

    A name *is* another one if they are equal in Unicode's NFC, without outer spaces (``clean``).
    A text *may mean* a name that differs in case, or in spaces, hyphens and underscores between
    letters (``loose``).
    """

    def __init__(self, names: Collection[str], earlier: KnownNames | None = None) -> None:
        """``names``: a mapping or a set; ``earlier``: more names, with their dictionaries."""
        self._names, self._earlier = names, earlier
        self._groups = dict[Callable[[str], str], dict[str, list[str]]]()

    def __contains__(self, text: str) -> bool:
        return text in self._names or (self._earlier is not None and text in self._earlier)

    def __iter__(self) -> Iterator[str]:
        yield from self._earlier or ()
        yield from self._names

    def _of_form(self, form_of: Callable[[str], str], form: str) -> list[str]:
        """The names with a form, such as ``clean``."""
        if form_of not in self._groups:
            self._groups[form_of] = _grouped(self._names, form_of)
        earlier = self._earlier._of_form(form_of, form) if self._earlier else []
        return earlier + self._groups[form_of].get(form, [])

    def same(self, text: str) -> str | None:
        """The name that a text is, or None."""
        for form in (text, clean(text)):
            if form in self:
                return form
        return next(iter(self._of_form(clean, clean(text))), None)

    def meant(self, text: str) -> str | None:
        """The only name that a text may mean, or None: also if several spellings are known."""
        meant = self._of_form(loose, loose(text))
        return meant[0] if len(meant) == 1 else None

    def find(self, text: str, place: str, expected: str) -> str:
        """The name that a text is; an ``InputError`` suggests similar names."""
        same = self.same(text)
        if same is None:
            problem = f"expected {expected} of this embedding, got {text!r:.80}"
            raise InputError(place, "", problem + self.hint(text))
        return same

    def queried(self, text: str, place: str, expected: str, note: Callable[[str], object]) -> str:
        """The name that a text of a question is, or else may mean, which a ``note`` says."""
        meant = None if self.same(text) is not None else self.meant(text)
        if meant is None:
            return self.find(text, place, expected)
        note(f"{text!r:.80} is not known: the answer is about {meant!r:.80}")
        return meant

    def resembled(self, text: str) -> str | None:
        """A name that a new one looks like: one that it may mean, or its plural or singular."""
        if meant := self._of_form(loose, loose(text)):
            return meant[0]
        forms = sorted(singulars(text) | plurals(text))
        near = [name for form in forms for name in self._of_form(plain, form)]
        return next((name for name in near if numbers(name) == numbers(text)), None)

    def hint(self, text: str) -> str:
        """A question that ends a message: which similar names a text may mean, or all."""
        wanted, by_plain = plain(text), _grouped(self, plain)
        forms = get_close_matches(wanted, by_plain, SUGGESTED) or [
            form for form in by_plain if wanted and wanted in form
        ]
        close = (
            self._of_form(loose, loose(text))[:LISTED]
            or [name for form in forms for name in by_plain[form]][:SUGGESTED]
            or list(self) * (len(by_plain) <= LISTED)
        )
        return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""


def _grouped(names: Iterable[str], form_of: Callable[[str], str]) -> dict[str, list[str]]:
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(form_of(name), []).append(name)
    return groups


def check_new(name: str, known: KnownNames, like: str | None, new: bool) -> None:
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


def plurals(name: str) -> set[str]:
    """The plain forms that have a name among their ``singulars``, and differ from it."""
    text = plain(name)
    forms = text + "s", text + "es", text[:-1] + "ies", text[:-1] + "ves", text[:-2] + "ves"
    return {form for form in forms if text in singulars(form)}


def by_known_name(
    values: Mapping[str, str], known: Collection[str]
) -> tuple[dict[str, str], list[str]]:
    """Values by the known name that theirs is (``KnownNames.same``), and the names of the others:
    of several for one name, the one that is written as the name, or else the first, counts.
    """
    known_names = KnownNames(dict.fromkeys(known))
    matched = {name: value for name, value in values.items() if name in known_names}
    missing = list[str]()
    for name, value in values.items():
        same = known_names.same(name)
        if same is None or (same != name and same in matched):
            missing.append(name)
        else:
            matched[same] = value
    return matched, missing


def note_of_kinds(
    missing: Sequence[str], listed: int, without: Sequence[str], known: Collection[str]
) -> str:
    """A sentence about listed names that match no entity, and entities without a kind;
    empty if there are none.
    """
    parts = []
    if missing:
        known_names = KnownNames(dict.fromkeys(known))
        meant = [known_names.meant(name) for name in missing[:SUGGESTED]]
        known_meant = [name for name in meant if name is not None]
        hint = f"; did you mean {_first(known_meant)}?" if known_meant else ""
        parts.append(
            f"{len(missing):,} of {listed:,} names match no entity ({_first(missing)}{hint})"
        )
    if without:
        number = f"{len(without):,} of {len(known):,}"
        parts.append(f"{number} entities have no kind ({_first(without)})")
    return "; ".join(parts)


def _first(names: Sequence[str]) -> str:
    return ", ".join(f"{name!r:.80}" for name in names[:SUGGESTED]) + ", ..." * (
        len(names) > SUGGESTED
    )
