"""Entities that are hidden from an embedding that another trainer makes: which, what is told of them, what is asked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
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
class HiddenTask:
    """Known entities, then hidden ones: a graph whose ids are dealt anew."""

    #: of known and hidden entities, in the graph's own ids; shape (E,)
    order: np.ndarray
    known: int
    #: among known entities; shape (K, 3)
    triples: np.ndarray
    #: of hidden ones, with a known end, each entity's in the order of telling; shape (I, 3)
    rest: np.ndarray
    #: of hidden ones, with a known end; shape (Q, 3)
    asked: np.ndarray
    #: all of the graph; shape (T, 3)
    true: np.ndarray

    def insert_triples(self, number: int | None) -> np.ndarray:
        """The first so many triples of each hidden entity, or all; shape (I', 3)."""
        place = np.arange(len(self.rest)) - np.searchsorted(
            _hidden_ends(self.rest, self.known), _hidden_ends(self.rest, self.known)
        )
        return self.rest if number is None else self.rest[place < number]


def measure_hidden(triples: np.ndarray, entities: int, how: Hidden, key: str, root: int, seed: int) -> HiddenTask:
    """Draw entities to hide, and what of their triples is told and asked.

    Entities are tried in a random order. One is hidden where all hidden ones keep enough triples with a known end, and
    all others, and all relations, a triple among known entities.

    Args:
        triples: unique ones of the graph; shape (T, 3).
        key: where ``how`` stands in params.

    Raises:
        InputError: where not so many can be hidden.
    """
    rng = stream(root, "hidden from another trainer", seed)
    hidden = _drawn(triples, entities, max(1, round(how.fraction * entities)), how.fewest, rng)
    if hidden is None:
        raise InputError(paths.BEYOND_PARAMS, f"{key}.fraction", "expected a share that leaves enough triples")
    order = np.concatenate([np.flatnonzero(~hidden), np.flatnonzero(hidden)])
    renamed = triples.copy()
    renamed[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
    known = int((~hidden).sum())
    ends = (renamed[:, [HEAD, TAIL]] >= known).sum(1)
    own = rng.permutation(renamed[ends == 1])
    own = own[np.argsort(_hidden_ends(own, known), kind="stable")]
    first = np.searchsorted(_hidden_ends(own, known), _hidden_ends(own, known))
    place, number = np.arange(len(own)) - first, np.bincount(first)[first]
    is_asked = place < np.maximum(1, (how.queries * number).astype(int))
    return HiddenTask(order, known, renamed[ends == 0], own[~is_asked], own[is_asked], renamed)


def _hidden_ends(triples: np.ndarray, known: int) -> np.ndarray:
    """The hidden end of triples that have one."""
    return np.where(triples[:, HEAD] >= known, triples[:, HEAD], triples[:, TAIL])


def _drawn(triples: np.ndarray, entities: int, number: int, fewest: int, rng: np.random.Generator) -> np.ndarray | None:
    """Which entities are hidden; shape (E,), bool. Null where there are too few to hide."""
    hidden = np.zeros(entities, dtype=bool)
    for entity in rng.permutation(entities):
        hidden[entity] = True
        hidden[entity] = _sound(triples, hidden, fewest)
        if hidden.sum() == number:
            return hidden
    return None


def _sound(triples: np.ndarray, hidden: np.ndarray, fewest: int) -> bool:
    """Whether hidden entities have enough triples with a known end, and all else a triple among known ones."""
    ends = hidden[triples[:, [HEAD, TAIL]]]
    inner, outer = triples[~ends.any(1)], triples[ends.sum(1) == 1]
    number = np.bincount(outer[:, [HEAD, TAIL]].flatten(), minlength=len(hidden))
    left = np.isin(np.flatnonzero(~hidden), inner[:, [HEAD, TAIL]]).all()
    return bool(left and number[hidden].min() >= fewest and np.isin(triples[:, RELATION], inner[:, RELATION]).all())


def mean_seconds(seconds: pd.DataFrame) -> list[dict[str, Any]]:
    """Means over seeds of what each method took, as a list of rows."""
    means = seconds.groupby(["method", "told"], dropna=False, sort=False)["seconds"].mean().round(3).reset_index()
    told = [None if pd.isna(number) else int(number) for number in means["told"]]
    return [
        {"method": method, "told": number, "seconds": mean}
        for method, number, mean in zip(means["method"], told, means["seconds"], strict=True)
    ]
