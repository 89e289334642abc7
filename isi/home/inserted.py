"""An entity before and after it is inserted, and the choice of what inserts it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isi.evaluation.platt import Curves
from isi.home.bundle import Fact, LossName
from isi.home.database import Database
from isi.home.phrases import NO_WORDS, PhraseVector

#: On what a choice depends: the number of facts with known entities, one of
#: ``isi.home.choices.PREPARED`` (of several new entities, the mean); whether all have word vectors;
#: what was asked for (``requested``).
Key = tuple[int, bool, str]


def requested(initializer: str | None, options: Mapping[str, Any]) -> str:
    """An initializer that was asked for, with its options, as JSON; empty if none was."""
    return "" if initializer is None else json.dumps([initializer, *sorted(options.items())])


@dataclass(frozen=True, eq=False)
class NewEntity:
    """An entity that is to be inserted: what was told about it, and what its facts and its name
    say.
    """

    kind: str | None  #: None, and then an empty text: unknown
    definition: str | None
    initializer: str | None  #: None: the one chosen on hidden known entities
    options: Mapping[str, Any]
    seed: int
    #: by relations of training, sorted, and how far each is believed
    facts: Mapping[Fact, float] = field(default_factory=dict)
    words: PhraseVector = NO_WORDS
    notes: tuple[str, ...] = ()  #: sentences on its kind, its words and unusual facts


@dataclass(frozen=True)
class Choice:
    """What serves the entities of a ``Key``, as tested on hidden known ones."""

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
    key: Key

    @classmethod
    def of_row(cls, row: Sequence[Any], dtype: np.dtype[Any]) -> InsertedEntity:
        """The entity of a row of ``Database.vectors_since``; ``dtype``: of vectors."""
        entity, vector, kind, initializer, options, why, fallback, notes, *of_key = row
        facts, words, named, named_options = of_key
        return cls(
            entity=entity,
            vector=np.frombuffer(vector, dtype),
            kind=kind,
            initializer=initializer,
            options=json.loads(options),
            why=why,
            fallback=fallback,
            notes=tuple(json.loads(notes)),
            key=(facts, bool(words), requested(named, json.loads(named_options))),
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
            "facts": self.key[0],
            "words": self.key[1],
            "vector": self.vector.tobytes(),
        }
        database.put_vector(row)
