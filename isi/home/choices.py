"""What serves the entities that are inserted into a home: for each number of facts, an initializer
and the curves of its probabilities, tested on hidden known entities and stored in the database.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from isi.evaluation.platt import Curves
from isi.home.database import Database
from isi.home.inserted import Choice, Conditions
from isi.home.loaded import LoadedEmbedding

#: Numbers of facts for which an initializer is selected. That for the largest one serves entities
#: with more.
PREPARED = (0, 1, 2, 3, 5, 8)


@dataclass(eq=False)
class Choices:
    """The choices of a home, read when they are needed, or made then."""

    base: LoadedEmbedding
    has_words: bool  #: whether new entities may have word vectors
    database: Database
    training: Any  #: ``Database.last_training`` of ``base``
    _made: dict[tuple[int, bool, str], Choice] = field(default_factory=dict)
    _warnings: list[str] = field(default_factory=list)  #: of choices that were made now

    def choice(self, conditions: Conditions) -> Choice:
        """What serves under some conditions: stored, or tested on hidden known entities now, which
        takes some seconds, and then stored.
        """
        key = conditions.key
        if key not in self._made:
            self._made[key] = self._stored(key) or self._store(key, self._choose(conditions))
        return self._made[key]

    def forget(self) -> None:
        """Read choices again: the transaction that stored some may have been rolled back."""
        self._made.clear()

    def warnings(self) -> list[str]:
        """The warnings of choices that were made since the last call."""
        warnings, self._warnings = self._warnings, []
        return warnings

    def preparation(self) -> list[Conditions]:
        """The conditions for which a choice is still to be made: all numbers of facts, with words
        if there are any (for a name without words, the choice is made when it comes).
        """
        every = [Conditions(number, self.has_words, None, (), 0) for number in PREPARED]
        return [conditions for conditions in every if not self._is_made(conditions.key)]

    def _is_made(self, key: tuple[int, bool, str]) -> bool:
        return key in self._made or self._stored(key) is not None

    def _choose(self, conditions: Conditions) -> Choice:
        from isi.home.choosing import choose  # here, since it loads PyTorch

        choice = choose(self.base, conditions)
        if conditions.initializer is None:
            self._warnings += choice.warnings
        return choice

    def _stored(self, key: tuple[int, bool, str]) -> Choice | None:
        row = self.database.choice(*key)
        if row is None:
            return None
        initializer, options, why, trained_with, warnings, curves = row
        options, warnings = json.loads(options), json.loads(warnings)
        fitted = None if curves is None else Curves.of_stored(json.loads(curves))
        return Choice(initializer, options, why, trained_with, warnings, fitted)

    def _store(self, key: tuple[int, bool, str], choice: Choice) -> Choice:
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
        if self.database.is_read_only:
            return choice
        with self.database.transaction():
            # else the home was trained again meanwhile: the choice is of another embedding
            if self.database.last_training() == self.training:
                self.database.put_choice(row)
        return choice


def prepared(facts: float) -> int:
    """The number in ``PREPARED`` that serves so many facts."""
    return max(number for number in PREPARED if number <= facts)
