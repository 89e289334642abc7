"""What serves the entities that are inserted into a home: for each number of facts, an initializer
and the curves of its probabilities, tested on hidden known entities and stored in the database.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from isi.evaluation.platt import PlattCurve
from isi.home.database import Database
from isi.home.loaded import LoadedEmbedding
from isi.insertion.hidden import HoldOut
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.selection import named, one_score, select
from isi.models.losses import Loss, loss_named
from isi.models.stack import usual_torch

#: Numbers of facts for which an initializer is selected. That for the largest one serves entities
#: with more.
PREPARED = (0, 1, 2, 3, 5, 8)
#: Of the selection: a home gets many entities, one after another.
HARM = 0.005


class Conditions(NamedTuple):
    """The conditions of an insertion: under equal ones, entities get the same initializer."""

    facts: int  #: mean number with known entities; one of ``PREPARED``
    words: bool  #: whether all have word vectors
    initializer: str | None  #: None: the one selected for so many facts
    options: tuple[tuple[str, Any], ...]
    seed: int

    @property
    def requested(self) -> str:
        """The initializer that was asked for, with its options; empty for none."""
        return "" if self.initializer is None else json.dumps([self.initializer, *self.options])

    @property
    def key(self) -> tuple[int, bool, str]:
        """What a choice depends on."""
        return self.facts, self.words, self.requested


@dataclass(frozen=True)
class Choice:
    """What serves entities under some conditions, as tested on hidden known ones."""

    initializer: str
    options: Mapping[str, Any]
    why: str
    trained_with: Loss  #: that of training, or the one that is assumed
    warnings: Sequence[str]
    curves: Curves | None  #: None: there are too few known triples


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
        base, entities = self.base, len(self.base.entities)
        number, words, warnings = conditions.facts, conditions.words, list[str]()
        with usual_torch():
            test = self._hold_out(number, words)
            selection = None
            if conditions.initializer is None:
                method, selection = select(test, number > 0, words, harm=HARM)
                warnings = list(selection.warnings) if selection else []
                self._warnings += warnings
            else:
                options = dict(conditions.options)
                method = named(conditions.initializer, options, base.model, entities)
                method = replace(method, trained_with=base.manifest.loss or "logistic")
            draws = replace(test, loss=method.trained_with).hide()
            curves = None if draws is None else fit_curves(draws, method)
        return Choice(
            method.initializer.name,
            dict(method.options),
            method.why,
            loss_named(method.trained_with).name,
            warnings,
            curves,
        )

    def _hold_out(self, number: int, words: bool) -> HoldOut:
        """The hold-out test with so many insert triples for each hidden entity."""
        base = self.base
        return HoldOut(
            replace(base.embedding, model=one_score(base.model)),
            base.triples,
            np.array([number]),
            base.words if words else None,
            base.kind_ids,
            seed=0,
            loss=base.manifest.loss,
        )

    def _stored(self, key: tuple[int, bool, str]) -> Choice | None:
        row = self.database.choice(*key)
        if row is None:
            return None
        initializer, options, why, trained_with, warnings, curves = row
        options, warnings = json.loads(options), json.loads(warnings)
        return Choice(initializer, options, why, trained_with, warnings, _curves_of(curves))

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
            "curves": _text_of(choice.curves),
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


def _text_of(curves: Curves | None) -> str | None:
    """Curves as JSON: slope and offset of all relations, and of each that has its own."""
    if curves is None:
        return None
    of_relation = {
        str(relation): list(vars(curve).values()) for relation, curve in curves.of_relation.items()
    }
    return json.dumps({"all": list(vars(curves.of_all).values()), **of_relation})


def _curves_of(text: str | None) -> Curves | None:
    if text is None:
        return None
    curves = {key: PlattCurve(*values) for key, values in json.loads(text).items()}
    of_all = curves.pop("all")
    return Curves({int(relation): curve for relation, curve in curves.items()}, of_all)
