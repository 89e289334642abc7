"""Entities that are hidden from an embedding that another trainer makes: which, their insert triples, their queries."""

from __future__ import annotations

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
from isi.tables.rules import at_least, one_of, within
from isi.tables.table import INT, NAME, REAL, Table

#: ``method``: what gave hidden entities their vectors. ``initializer``: of ``isi.pykeen.insert``, where that did.
#: ``told``: insert triples of each entity, at most (null: all). ``asked``: queries for the ``known`` end of a triple of
#: a hidden entity, for the ``hidden`` entity, or for the ends of ``earlier`` triples, of known entities alone, which
#: were not trained on; all entities are candidates.
HIDDEN_ENTITIES = Table(
    "data/beyond/hidden/{graph}.parquet",
    {"method": NAME, "initializer": NAME, "told": INT, "seed": INT, "asked": NAME, "entities": INT, "queries": INT,
     "mrr": REAL, "hits_at_10": REAL},
    key=["method", "initializer", "told", "seed", "asked"],
    checks=[*at_least(1, "told", "entities", "queries"), *at_least(0, "seed"),
            *one_of("asked", ("known", "hidden", "earlier")), *within(0, 1, "mrr", "hits_at_10")],
    nullable=["initializer", "told"],
)  # fmt: skip


def seconds_path(graph: str) -> Path:
    """Where the seconds of each method lie, beside ``HIDDEN_ENTITIES``."""
    return HIDDEN_ENTITIES.path(graph=graph).with_suffix(".seconds.json")


class HiddenTraining(Section):
    """How PyKEEN trains."""

    dimension: Count
    batch_size: Count
    learning_rate: Positive
    #: wrong triples beside each right one
    negatives: Count
    #: share of the known triples that says when to stop
    valid: Fraction
    max_epochs: Count
    #: epochs between two looks
    frequency: Count
    #: looks without a better one before it stops
    patience: Count


class Hidden(Section):
    """An entry of ``hidden`` in the params of the second pipeline."""

    renamed: ClassVar = {"asked": "queries", "told": "max_insert_triples"}
    #: what people read
    title: str
    #: where the graph is: in PyKEEN's package, or among ``graphs``, under the name of the entry
    source: Literal["pykeen", "graphs"]
    #: of its entities, if they have any
    words: Words | None
    seeds: Count
    #: share of the entities that is hidden
    fraction: Fraction
    #: triples with a known end that a hidden entity has, at least
    fewest: Annotated[int, Field(ge=2)]
    #: share of these that are queries; one at least
    queries: Fraction
    #: of the others, how many are insert triples; null: all
    max_insert_triples: Annotated[list[Count | None], Field(min_length=1)]
    #: set beside the one that ``isi.pykeen.insert`` takes where none is named
    initializers: list[Name]
    training: HiddenTraining
    #: of training with the new entities' triples
    epochs: Count


@dataclass(frozen=True)
class HiddenSplit:
    """A graph whose ids are dealt anew, known entities before hidden ones; triples are of shape (…, 3)."""

    #: of known and hidden entities, in the graph's own ids; shape (E,)
    order: np.ndarray
    known: int
    #: among known entities
    triples: np.ndarray
    #: of hidden ones, with a known end: by entity, in random order, to insert from and to query
    rest: np.ndarray
    queries: np.ndarray
    #: all of the graph
    true: np.ndarray

    def insert_triples(self, number: int | None) -> np.ndarray:
        """The first so many triples of each hidden entity, or all; shape (I', 3)."""
        return self.rest if number is None else self.rest[_places(self.rest, self.known)[0] < number]


def hide(triples: np.ndarray, entities: int, settings: Hidden, key: str, root: int, seed: int) -> HiddenSplit:
    """Draw entities to hide, and which of their triples are inserted from and queried.

    Args:
        triples: of the graph; shape (T, 3).
        key: where the settings stand in params.

    Raises:
        InputError: where not so many can be hidden.
    """
    rng = stream(root, "hidden from another trainer", seed)
    hidden = _draw(triples, entities, max(1, round(settings.fraction * entities)), settings.fewest, rng)
    if hidden is None:
        raise InputError(paths.BEYOND_PARAMS, f"{key}.fraction", "expected a share that leaves enough triples")
    order, known = np.argsort(hidden, kind="stable"), int((~hidden).sum())
    renamed = triples.copy()
    renamed[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
    ends = (renamed[:, [HEAD, TAIL]] >= known).sum(1)
    rest = rng.permutation(renamed[ends == 1])
    rest = rest[np.argsort(_hidden_ends(rest, known), kind="stable")]
    place, number = _places(rest, known)
    is_query = place < np.maximum(1, (settings.queries * number).astype(int))
    return HiddenSplit(order, known, renamed[ends == 0], rest[~is_query], rest[is_query], renamed)


def _hidden_ends(triples: np.ndarray, known: int) -> np.ndarray:
    """The hidden end of triples that have one."""
    return np.where(triples[:, HEAD] >= known, triples[:, HEAD], triples[:, TAIL])


def _places(triples: np.ndarray, known: int) -> tuple[np.ndarray, np.ndarray]:
    """Place of each triple among those of its hidden end, which stand together, and how many these are."""
    _, first, inverse, number = np.unique(
        _hidden_ends(triples, known), return_index=True, return_inverse=True, return_counts=True
    )
    return np.arange(len(triples)) - first[inverse], number[inverse]


def _draw(triples: np.ndarray, entities: int, number: int, fewest: int, rng: np.random.Generator) -> np.ndarray | None:
    """Which entities are hidden, shape (E,), bool; null where there are too few to hide.

    Hidden ones have enough triples with a known end, and all other entities and relations a triple of known ones.
    """
    hidden = np.zeros(entities, dtype=bool)
    for entity in rng.permutation(entities):
        hidden[entity] = True
        ends = hidden[triples[:, [HEAD, TAIL]]].sum(1)
        inner, outer = triples[ends == 0], triples[ends == 1]
        per_entity = np.bincount(outer[:, [HEAD, TAIL]].flatten(), minlength=entities)
        learnable = np.isin(np.flatnonzero(~hidden), inner[:, [HEAD, TAIL]]).all()
        has_relations = np.isin(triples[:, RELATION], inner[:, RELATION]).all()
        hidden[entity] = learnable and has_relations and per_entity[hidden].min() >= fewest
        if hidden.sum() == number:
            return hidden
    return None
