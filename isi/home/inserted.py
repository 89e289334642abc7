"""An inserted entity as its home has it, and the choice of what inserted it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from isi.evaluation.platt import Curves
from isi.home.bundle import LossName
from isi.home.database import Database


class Conditions(NamedTuple):
    """The conditions of an insertion: under equal ones, entities get the same initializer."""

    facts: int  #: mean number with known entities; one of ``isi.home.choices.PREPARED``
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
    trained_with: LossName  #: that of training, or the one that is assumed
    warnings: Sequence[str]
    curves: Curves | None  #: None: there are too few known triples


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An inserted entity as it stands."""

    entity: str
    vector: np.ndarray  #: shape: (d,)
    kind: str
    initializer: str
    options: Mapping[str, Any]
    why: str  #: the reason for this initializer
    fallback: str | None  #: the rule that replaced it for lack of data, or None
    notes: tuple[str, ...]
    conditions: Conditions

    @classmethod
    def of_row(cls, row: Sequence[Any], dtype: np.dtype[Any]) -> InsertedEntity:
        """The entity of a row of ``Database.vectors_after``; ``dtype``: of vectors."""
        entity, vector, kind, initializer, options, why, fallback, notes, *of_conditions = row
        facts, words, requested, requested_options, seed = of_conditions
        return cls(
            entity=entity,
            vector=np.frombuffer(vector, dtype),
            kind=kind,
            initializer=initializer,
            options=json.loads(options),
            why=why,
            fallback=fallback,
            notes=tuple(json.loads(notes)),
            conditions=Conditions(
                facts,
                bool(words),
                requested,
                tuple(sorted(json.loads(requested_options).items())),
                seed,
            ),
        )

    def store(self, database: Database, change: int) -> None:
        """Write it, as a change's."""
        row = {
            "entity": self.entity,
            "change": change,
            "initializer": self.initializer,
            "options": json.dumps(dict(self.options)),
            "why": self.why,
            "fallback": self.fallback,
            "kind": self.kind,
            "notes": json.dumps(self.notes),
            "facts": self.conditions.facts,
            "words": self.conditions.words,
            "vector": self.vector.tobytes(),
        }
        database.put_vector(row)
