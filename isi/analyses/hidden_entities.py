"""Entities held out from PyKEEN's training: which, their insert triples and their queries."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from isi.config import Count, Fraction, Name, Positive, Section
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.words import Words
from isi.random import stream
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, one_of
from isi.tables.table import Table

#: ``method``: what gave hidden entities their vectors. ``initializer``: of ``isi.pykeen.insert``, where that did.
#: ``told``: insert triples of each entity, at most (null: all). ``asked``: queries for the ``known`` end of a triple of
#: a hidden entity, for the ``hidden`` entity, or for the ends of ``earlier`` triples, of known entities alone, which
#: were not trained on; all entities are candidates.
HIDDEN_ENTITIES = Table(
    "data/beyond/hidden/{graph}.parquet",
    {"method": NAME, "initializer": NAME.optional, "told": FROM_1.optional, "seed": FROM_0,
     "asked": one_of("known", "hidden", "earlier"), "entities": FROM_1, "queries": FROM_1, "mrr": SHARE,
     "hits_at_10": SHARE},
    key=["method", "initializer", "told", "seed", "asked"],
)  # fmt: skip


def seconds_path(graph: str) -> Path:
    """Path of the seconds that each method took, beside ``HIDDEN_ENTITIES``."""
    return HIDDEN_ENTITIES.path(graph=graph).with_suffix(".seconds.json")


class HiddenTraining(Section):
    """``training`` of an entry of ``hidden``: how PyKEEN trains."""

    dimension: Count
    batch_size: Count
    learning_rate: Positive
    negatives: Count  #: wrong triples beside each right one
    valid: Fraction  #: share of the known triples that says when to stop
    max_epochs: Count
    frequency: Count  #: epochs between two looks
    patience: Count  #: looks without a better one before it stops


class Hidden(Section):
    """An entry of ``hidden`` in the params of the second pipeline."""

    renamed: ClassVar = {"asked": "queries", "told": "max_insert_triples"}
    title: str  #: in the report
    source: Literal["pykeen", "graphs"]  #: of PyKEEN's package, or the entry of that name in ``graphs``
    words: Words | None  #: of its entities, if they have any
    seeds: Count
    fraction: Fraction  #: share of the entities that is hidden
    fewest: Annotated[int, Field(ge=2)]  #: triples with a known end that a hidden entity has, at least
    queries: Fraction  #: share of these triples that become queries; at least one
    max_insert_triples: Annotated[list[Count | None], Field(min_length=1)]  #: most insert triples; null: all others
    initializers: list[Name]  #: set beside the one that ``isi.pykeen.insert`` takes where none is named
    training: HiddenTraining
    epochs: Count  #: of training with the new entities' triples


@dataclass(frozen=True)
class HiddenSplit:
    """A graph renumbered with known entities before hidden ones; triples have shape (…, 3)."""

    order: np.ndarray  #: of known and hidden entities, in the graph's own ids; shape (E,)
    known: int
    triples: np.ndarray  #: among known entities
    rest: np.ndarray  #: insert candidates, (I, 3): a hidden and a known end; by entity, in random order
    place: np.ndarray  #: index of each row of ``rest`` within its entity
    queries: np.ndarray  #: the other triples of a hidden and a known entity, likewise; shape (Q, 3)
    true: np.ndarray  #: all triples of the graph

    def insert_triples(self, number: int | None) -> np.ndarray:
        """The first ``number`` insert triples of each hidden entity, null: all; shape (I', 3)."""
        return self.rest if number is None else self.rest[self.place < number]


def hide(triples: np.ndarray, entities: int, settings: Hidden, key: str, root: int, seed: int) -> HiddenSplit:
    """Sample hidden entities of ``fewest`` triples or more with known ends; known entities keep a known triple."""
    rng, hidden = stream(root, "hidden from another trainer", seed), np.zeros(entities, dtype=bool)
    for entity in rng.permutation(entities):
        hidden[entity] = True
        ends = hidden[triples[:, [HEAD, TAIL]]].sum(1)
        inner, outer = triples[ends == 0], triples[ends == 1]
        per_entity = np.bincount(outer[:, [HEAD, TAIL]].flatten(), minlength=entities)
        learnable = np.isin(np.flatnonzero(~hidden), inner[:, [HEAD, TAIL]]).all()
        has_relations = np.isin(triples[:, RELATION], inner[:, RELATION]).all()
        hidden[entity] = learnable and has_relations and per_entity[hidden].min() >= settings.fewest
        if hidden.sum() == max(1, round(settings.fraction * entities)):
            break
    else:
        raise InputError(paths.BEYOND_PARAMS, f"{key}.fraction", "expected a lower share: too few triples are left")
    order, known = np.argsort(hidden, kind="stable"), int((~hidden).sum())
    renamed = triples.copy()
    renamed[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
    ends = (renamed[:, [HEAD, TAIL]] >= known).sum(1)
    rest = rng.permutation(renamed[ends == 1])
    entity = rest[:, [HEAD, TAIL]].max(1)  # the hidden end: hidden ones are numbered behind the known
    rest, entity = rest[np.argsort(entity, kind="stable")], np.sort(entity)
    _, first, inverse, number = np.unique(entity, return_index=True, return_inverse=True, return_counts=True)
    place, queried = np.arange(len(rest)) - first[inverse], np.maximum(1, (settings.queries * number).astype(int))
    later = place - queried[inverse]
    inserted = later >= 0
    return HiddenSplit(order, known, renamed[ends == 0], rest[inserted], later[inserted], rest[~inserted], renamed)
