"""Names and ids of entities, relations or kinds, and what a text that is no name may mean;
triples of names as ids; names of new entities, and lists of kinds, beside the known names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import cached_property
from operator import itemgetter
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from isi.config import as_list, is_whole, plain_number
from isi.errors import InputError, at
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.names import check_name, clean, plain

#: Maximum number of names that a message suggests: similar ones, or all names.
SUGGESTED, LISTED = 3, 8
SHORTEST = 4  #: Minimum length of a new name that is compared with known ones.
#: Neither digit nor underscore; Python's digits lack those of ², ½ and ₃.
LETTER = r"[^\W\d_\u00b2\u00b3\u00b9\u00bc-\u00be\u2070-\u2189]"
#: Separators between two letters.
BETWEEN_LETTERS = re.compile(rf"(?<={LETTER})[ _-]+(?={LETTER})")

NewName = Annotated[str, AfterValidator(check_name)]


class Vocabulary:
    """The names of one kind of thing by id, and their ids by name.
    Without names, things have ids alone.

    A text *is* a name if they are equal in Unicode's NFC, without outer spaces (``clean``). It *may
    mean* a name that differs in case, or in spaces, hyphens and underscores between letters
    (``loose``). What finds such names is built when it is needed.

    Example:
        >>> from isi.vocabulary import Vocabulary
        >>> rooms = Vocabulary("entity", ["kitchen", "living room"])
        >>> rooms.id("kitchen", ""), rooms.of(1), rooms.meant("LivingRoom")
        (0, 'living room', 'living room')
        >>> rooms.find("kitchn")
        Traceback (most recent call last):
        isi.errors.InputError: entity: expected a known name, got 'kitchn'; did you mean 'kitchen'?
    """

    def __init__(
        self,
        kind: str,
        names: Iterable[str] | None,
        number: int | None = None,
        *,
        numbers_are_ids: bool = False,
        earlier: Vocabulary | None = None,
        argument: str | None = None,
    ) -> None:
        """
        Args:
            kind: ``entity``, ``relation`` or ``kind``.
            names: by id; None: things have ids alone.
            number: of things; None: of ``names``.
            numbers_are_ids: whether a number is an id, also if it is the name of another thing;
                else it is refused.
            earlier: the vocabulary whose names have the ids before those of ``names``.
            argument: the argument that an error names; None: ``entity_names`` or so.

        Raises:
            InputError: ``names`` are no list of names, repeat, or are not ``number``.
        """
        self.kind, self.numbers_are_ids, self._earlier = kind, numbers_are_ids, earlier
        self.ids: dict[str, int] = dict(earlier.ids) if earlier else {}
        with at(f"argument {argument or f'{kind}_names'!r}"):
            self._own = [] if names is None else as_list(names, str, "a list of names")
            if number is None:
                number = len(self.ids) + len(self._own)
            elif names is not None and len(self._own) != number:
                raise InputError("", "", f"expected {number} names, got {len(self._own)}")
            for row, name in enumerate(self._own, len(self.ids)):
                if self.ids.setdefault(name, row) != row:
                    expected = "expected names that do not repeat"
                    if earlier is not None and name in earlier.ids:
                        expected = "expected a new name: it is known already"
                    raise InputError("", repr(name)[:80], expected)
        self.number = number  #: of things
        self.names = None if names is None else list(self.ids)  #: by id
        self._groups = dict[Callable[[str], str], dict[str, list[str]]]()

    def with_new(self, new: Any, argument: str) -> Vocabulary:
        """This vocabulary with new things: their names if the known ones have names, else their
        number. An ``InputError`` names the ``argument``.
        """
        new, has_names = plain_number(new), self.names is not None
        if is_whole(new) == has_names and (not has_names or new):
            expected = f"expected names where '{self.kind}_names' are given, else a whole number"
            raise InputError(f"argument {argument!r}", "", expected)
        if is_whole(new) and new < 0:
            raise InputError(
                f"argument {argument!r}", "", f"expected a number from 0 on, got {new}"
            )
        if not has_names:
            return Vocabulary(self.kind, None, self.number + int(new))
        return Vocabulary(
            self.kind,
            [] if is_whole(new) else new,
            numbers_are_ids=self.numbers_are_ids,
            earlier=self,
            argument=argument,
        )

    def of(self, row: int) -> str | int:
        """The name of an id, or the id."""
        return row if self.names is None else self.names[row]

    @cached_property
    def ambiguous(self) -> set[int]:
        """Numbers that are an id, and the name of another thing, which are refused."""
        numbers = {name: row for name, row in self.ids.items() if _is_number(name)}
        others = {int(name) for name, row in numbers.items() if int(name) != row}
        return set() if self.numbers_are_ids else others

    def id(self, value: Any, place: str) -> int:
        """The id of a value that is a name or an id; an ``InputError`` names its ``place``."""
        value = plain_number(value)
        if isinstance(value, str) and value in self.ids:
            return self.ids[value]
        if is_whole(value) and 0 <= value < self.number:
            if value in self.ambiguous:
                expected = f"expected a name: {value} is an id, and the name of another row"
                raise InputError("", place, expected)
            return int(value)
        expected = f"expected an id from 0 to {self.number - 1}"
        if self.names is not None:
            expected += ", or a known " + "or new " * (self.kind == "entity") + self.kind
            expected += " (new ones: new_relations)" * (self.kind == "relation")
        got = int(value) if is_whole(value) else value
        hint = self.hint(value) if isinstance(value, str) else ""
        raise InputError("", place, f"{expected}, got {got!r:.80}{hint}")

    def same(self, text: str) -> str | None:
        """The name that a text is, or None."""
        for form in (text, clean(text)):
            if form in self.ids:
                return form
        return next(iter(self._of_form(clean, clean(text))), None)

    def meant(self, text: str) -> str | None:
        """The only name that a text may mean, or None: also if several spellings are known."""
        meant = self._of_form(loose, loose(text))
        return meant[0] if len(meant) == 1 else None

    def find(self, text: str, place: str | None = None) -> str:
        """The name that a text is; an ``InputError`` at ``place``, or else the kind of thing,
        suggests similar names.
        """
        same = self.same(text)
        if same is None:
            problem = f"expected a known name, got {text!r:.80}"
            raise InputError(place or self.kind, "", problem + self.hint(text))
        return same

    def taken_for(self, text: str, note: Callable[[str], object]) -> str | None:
        """The name that a text is, or else may mean, which a ``note`` says; None for a new one. An
        ``InputError`` refuses a text that may mean several.
        """
        same = self.same(text)
        if same is not None:
            return same
        meant = self._of_form(loose, loose(text))
        if len(meant) > 1:
            expected = f"expected one of {', '.join(map(repr, meant[:LISTED]))}"
            raise InputError(self.kind, "", f"{expected}, got {text!r:.80}")
        if not meant:
            return None
        note(f"{text!r:.80} is taken for {meant[0]!r:.80}")
        return meant[0]

    def queried(self, text: str, note: Callable[[str], object]) -> str:
        """The known name that a text of a question is, or may mean, which a ``note`` says."""
        return self.taken_for(text, note) or self.find(text)

    def misspelt(self, new: Collection[str]) -> dict[str, str]:
        """For new names that a slip of the pen may have made of a known one, that one.

        They differ in case, blanks, hyphens, underscores and Unicode's forms, or in one letter
        (another, missing, added, or exchanged with its neighbour), but in no number.
        """
        compared = [name for name in new if len(name) >= SHORTEST]
        spellings = {form: name for name in compared for form in _spellings(name)}
        lengths = {len(form) + more for form in spellings for more in (-1, 0, 1)}
        near = dict[str, str]()
        for known in self.ids:
            if len(loose(known)) in lengths:
                for form in _spellings(known) & spellings.keys():
                    name = spellings[form]
                    if numbers(name) == numbers(known):
                        near.setdefault(name, known)
        return near

    def hint(self, text: str) -> str:
        """A question that ends a message: which similar names a text may mean, or all."""
        wanted, by_plain = plain(text), _grouped(self.ids, plain)
        forms = get_close_matches(wanted, by_plain, SUGGESTED) or [
            form for form in by_plain if wanted and wanted in form
        ]
        close = (
            self._of_form(loose, loose(text))[:LISTED]
            or [name for form in forms for name in by_plain[form]][:SUGGESTED]
            or list(self.ids) * (len(by_plain) <= LISTED)
        )
        return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""

    def _of_form(self, form_of: Callable[[str], str], form: str) -> list[str]:
        """The names with a form, such as ``clean``."""
        if form_of not in self._groups:
            self._groups[form_of] = _grouped(self._own, form_of)
        earlier = self._earlier._of_form(form_of, form) if self._earlier else []
        return earlier + self._groups[form_of].get(form, [])


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
    missing: Sequence[str], number: int, without: Sequence[str], known: Vocabulary
) -> str:
    """A sentence about those of ``number`` names that match no entity, and entities without a kind;
    empty if there are none.
    """
    parts = []
    if missing:
        meant = [known.meant(name) for name in missing[:SUGGESTED]]
        known_meant = [name for name in meant if name is not None]
        hint = f"; did you mean {_first_of(known_meant)}?" if known_meant else ""
        parts.append(
            f"{len(missing):,} of {number:,} names match no entity ({_first_of(missing)}{hint})"
        )
    if without:
        share = f"{len(without):,} of {known.number:,}"
        parts.append(f"{share} entities have no kind ({_first_of(without)})")
    return "; ".join(parts)


def _first_of(names: Sequence[str]) -> str:
    return ", ".join(f"{name!r:.80}" for name in names[:SUGGESTED]) + ", ..." * (
        len(names) > SUGGESTED
    )


def loose(name: str) -> str:
    """What is left of a name as people type it from memory: without case, and without spaces,
    hyphens and underscores between two letters.

    ``coffeeMachine`` and ``Coffee-machine`` → ``coffeemachine``; ``chair_1_12`` → ``chair 1 12``;
    ``a-1`` → ``a-1``. It suggests names and is never a key of data: mW is not MW.
    """
    return re.sub("[ _]+", " ", BETWEEN_LETTERS.sub("", clean(name))).casefold()


def numbers(name: str) -> list[str]:
    """The numbers of a name with their signs, and signs alone: ``chair_11_-2`` → 11 and -2."""
    return re.findall(r"[+-]?\d+|(?<!\w)[+-]", name)


def names_by_id(ids: Mapping[str, int]) -> list[str]:
    """Names in the order of their ids."""
    return sorted(ids, key=ids.__getitem__)


def ids_by_name(
    triples: Collection[Sequence[str]], entities: Mapping[str, int], relations: Mapping[str, int]
) -> np.ndarray:
    """Triples of names as ids, shape (T, 3), int64; ``KeyError`` for an unknown name."""
    columns = []
    for slot, ids in enumerate((entities, relations, entities)):
        columns.append(list(map(ids.__getitem__, map(itemgetter(slot), triples))))
    return np.array(columns, np.int64).T.copy()


def numbered(
    triples: np.ndarray, in_order: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triples of names or numbers, (T, 3), as ids, (T, 3), int64; and the entities, (E,), and
    relations, (R,), by id: sorted if ``in_order``, else as they first appear, head before tail.

    Example:
        >>> import numpy as np
        >>> from isi.vocabulary import numbered
        >>> triples = np.array([("mug", "in", "kitchen"), ("cup", "in", "kitchen")], object)
        >>> ids, entities, relations = numbered(triples)
        >>> ids.tolist(), list(entities)
        ([[0, 0, 1], [2, 0, 1]], ['mug', 'kitchen', 'cup'])
    """
    import pandas as pd

    ends, entities = pd.factorize(triples[:, [HEAD, TAIL]].flatten(), sort=in_order)
    relation, relations = pd.factorize(triples[:, RELATION], sort=in_order)
    head, tail = ends.reshape(-1, 2).T
    ids = np.stack([head, relation, tail], 1).astype(np.int64)
    return ids, np.asarray(entities), np.asarray(relations)


def _grouped(names: Iterable[str], form_of: Callable[[str], str]) -> dict[str, list[str]]:
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(form_of(name), []).append(name)
    return groups


def _is_number(name: str) -> bool:
    """Whether a name is a whole number, written as Python writes it."""
    return name.isdecimal() and name.isascii() and len(name) < 19 and str(int(name)) == name


def _spellings(name: str) -> set[str]:
    """A name without case and marks, and all texts that lack one of its characters."""
    text = loose(name)
    return {text, *(text[:place] + text[place + 1 :] for place in range(len(text)))}
