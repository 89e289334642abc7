"""What serves the entities that are inserted into a home: for each number of facts, an initializer
and the curves of its probabilities, tested on hidden known entities and stored in the database.

To make a choice takes seconds. So it is made outside of transactions: a change that lacks one ends
with ``NotChosen``, and begins again when it is made. A question does without.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field

from isi.evaluation.platt import Curves
from isi.home.database import Database
from isi.home.inserted import Choice, Key
from isi.home.loaded import LoadedEmbedding

#: Numbers of facts for which curves are fitted; those for the largest one serve entities with more.
#: And those for which an initializer is selected, which serves the next ones, too.
PREPARED, SELECTED = (0, 1, 2, 3, 5, 8), (0, 1, 5)


class NotChosen(Exception):
    """A change needs a choice that is not made yet."""

    def __init__(self, choices: Choices, key: Key, selected: Choice | None) -> None:
        """``selected``: the choice whose initializer serves; None: one is to be selected."""
        super().__init__(key)
        self.choices, self.key, self.selected = choices, key, selected

    def make(self) -> None:
        """Make the choice; it is stored by the next change that needs it."""
        from isi.home.choosing import choose  # here, since it loads PyTorch

        self.choices.made[self.key] = choose(self.choices.base, self.key, self.selected)


@dataclass(eq=False)
class Choices:
    """The choices of a home."""

    base: LoadedEmbedding
    database: Database
    made: dict[Key, Choice] = field(default_factory=dict)  #: here; they may be stored, or not
    _read: dict[Key, Choice] = field(default_factory=dict)
    _warnings: list[str] = field(default_factory=list)

    @property
    def has_words(self) -> bool:
        """Whether new entities may have word vectors."""
        return self.base.words is not None and self.base.manifest.words is not None

    def find(self, key: Key) -> Choice | None:
        """The stored choice, if there is one."""
        if key not in self._read:
            row = self.database.choice(*key)
            if row is None:
                return None
            initializer, options, why, trained_with, warnings, curves = row
            self._read[key] = Choice(
                initializer,
                json.loads(options),
                why,
                trained_with,
                json.loads(warnings),
                None if curves is None else Curves.of_stored(json.loads(curves)),
            )
        return self._read[key]

    def needed(self, key: Key) -> Choice:
        """The choice that a change needs, and with which it is stored if it was made now;
        ``NotChosen`` if it was not.
        """
        choice = self.find(key)
        if choice is not None:
            return choice
        if key not in self.made:
            source = self._source(key)
            selected = None if source == key else self.needed(source)
            self.forget()  # the transaction ends here
            raise NotChosen(self, key, selected)
        choice = self.made[key]
        self._store(key, choice)
        self._warnings += choice.warnings
        return choice

    def _source(self, key: Key) -> Key:
        """The choice whose initializer serves; that of names with words if there are any."""
        facts, _, requested = key
        if requested:
            return key
        return max(number for number in SELECTED if number <= facts), self.has_words, ""

    def forget(self) -> None:
        """Read choices again: the transaction that stored some is rolled back."""
        self._read.clear()

    def warnings(self) -> list[str]:
        """The warnings of choices that were stored since the last call."""
        warnings, self._warnings = self._warnings, []
        return warnings

    def preparation(self) -> list[Key]:
        """The choices that are still to be made: for all numbers of facts, with words if there are
        any, and without.
        """
        words = (True, False) if self.has_words else (False,)
        keys = [(number, has_words, "") for has_words in words for number in PREPARED]
        return [key for key in keys if self.find(key) is None]

    def _store(self, key: Key, choice: Choice) -> None:
        facts, words, requested = key
        row = {
            "facts": facts,
            "words": words,
            "requested": requested,
            "initializer": choice.initializer,
            "options": json.dumps(choice.options),
            "why": choice.why,
            "trained_with": choice.trained_with,
            "warnings": json.dumps(list(choice.warnings)),
            "curves": None if choice.curves is None else json.dumps(choice.curves.stored()),
        }
        self.database.put_choice(row)


def prepared(facts: float) -> int:
    """The number in ``PREPARED`` that serves so many facts."""
    return max(number for number in PREPARED if number <= facts)
