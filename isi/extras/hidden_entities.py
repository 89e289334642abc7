"""A graph split for PyKEEN: entities hidden from its training,
their insert triples and their queries.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from isi.config import Count, Fraction, Name, Positive, Section, check
from isi.errors import InputError, at
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.words import Words
from isi.initializers.api import INITIALIZERS
from isi.params import check_names
from isi.random import stream
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, one_of
from isi.tables.table import Table

#: ``method``: key of ``methods`` in ``hidden_in``, or nothing (before any insertion).
#: ``initializer``: that of ``isi.pykeen.insert``; null for methods without it. ``told``: maximum
#: number of insert triples per entity (null: all). ``asked``: the answer is the ``known`` or the
#: ``hidden`` end of a triple of a hidden entity, or (``earlier``) either end of a validation triple
#: of known entities. All entities are candidates. ``entities``: number of hidden.
HIDDEN_ENTITIES = Table(
    "data/beyond/hidden/{study}.parquet",
    {
        "method": NAME,
        "initializer": NAME.optional,
        "told": FROM_1.optional,
        "seed": FROM_0,
        "asked": one_of("known", "hidden", "earlier"),
        "entities": FROM_1,
        "queries": FROM_1,
        "mrr": SHARE,
        "hits_at_10": SHARE,
    },
    key=["method", "initializer", "told", "seed", "asked"],
)


def seconds_path(study: str) -> Path:
    """Path of a JSON file in the folder of ``HIDDEN_ENTITIES``:
    mean CPU seconds of each method by ``told``.
    """
    return HIDDEN_ENTITIES.path(study=study).with_suffix(".seconds.json")


class HiddenTraining(Section):
    """``training`` in an entry of ``hidden``: the settings of PyKEEN's training."""

    model: Name  #: PyKEEN's name of a model, in lower case
    loss: Name  #: PyKEEN's name of a loss
    loss_options: dict[str, float] = Field(default_factory=dict)
    dimension: Count
    batch_size: Count
    learning_rate: Positive
    negatives: Count  #: negative triples per positive triple
    valid: Fraction  #: share of the known triples, the validation set of early stopping
    max_epochs: Count
    frequency: Count  #: epochs between two evaluations
    patience: Count  #: evaluations without improvement before training stops


class Hidden(Section):
    """An entry of ``hidden`` in the params of the second pipeline:
    a graph, and which of its entities are hidden.
    """

    title: str  #: in the table of the documentation
    graph: Name
    #: where ``graph`` is: PyKEEN's datasets, the entries of ``graphs``, or
    #: ``data/raw/GRAPH/triples.csv``
    source: Literal["pykeen", "graphs", "table"]
    words: Words | None  #: word vectors of the entities; None: the graph has none
    seeds: Count
    fraction: Fraction  #: share of the entities that is hidden
    #: minimum number of a hidden entity's triples with a known end
    fewest: Annotated[int, Field(ge=2)]
    #: share of those triples that become queries (rounded down, at least one triple)
    queries: Fraction
    #: per entity; null: all but the queries
    max_insert_triples: Annotated[list[Count | None], Field(min_length=1)]
    initializers: list[Name]  #: compared with the default initializer of ``isi.pykeen.insert``
    training: HiddenTraining
    epochs: Count  #: of training after insertion


def study_of(studies: Mapping[str, dict[str, Any]], study: str) -> Hidden:
    """An entry of ``hidden``, checked; InputError names the wrong key of ``beyond/params.yaml``."""
    key = f"hidden.{study}"
    settings = check(studies[study], Hidden, key, paths.BEYOND_PARAMS)
    with at(paths.BEYOND_PARAMS):
        check_names(settings.initializers, INITIALIZERS.names(), f"{key}.initializers")
    return settings


@dataclass(frozen=True)
class HiddenSplit:
    """A graph whose entities are renumbered: known ones first, then hidden ones;
    triples have the new ids.
    """

    order: np.ndarray  #: the graph's id of each entity by new id; shape (E,)
    known: int  #: number of known entities
    triples: np.ndarray  #: triples between known entities; shape (T, 3)
    #: insert triples: a hidden and a known end; sorted by hidden entity, then random; shape (I, 3)
    rest: np.ndarray
    #: index of each row of ``rest`` among the rows of its hidden entity; shape (I,)
    place: np.ndarray
    #: query triples: a hidden and a known end; sorted as ``rest``; shape (Q, 3)
    queries: np.ndarray
    true: np.ndarray  #: all triples of the graph; shape (N, 3)

    def insert_triples(self, number: int | None) -> np.ndarray:
        """The first ``number`` insert triples of each hidden entity (None: all); shape (≤ I, 3)."""
        return self.rest if number is None else self.rest[self.place < number]


def hide(
    triples: np.ndarray, entities: int, settings: Hidden, key: str, root: int, seed: int
) -> HiddenSplit:
    """Hide random entities; others and relations keep a triple of known ones;
    InputError if too few can be hidden.
    """
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
        raise InputError(
            paths.BEYOND_PARAMS,
            f"{key}.fraction",
            "expected a lower share: too few triples are left",
        )
    order, known = np.argsort(hidden, kind="stable"), int((~hidden).sum())
    renamed = triples.copy()
    renamed[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
    ends = (renamed[:, [HEAD, TAIL]] >= known).sum(1)
    rest = rng.permutation(renamed[ends == 1])
    # the hidden end: hidden entities have higher ids than known ones
    entity = rest[:, [HEAD, TAIL]].max(1)
    rest, entity = rest[np.argsort(entity, kind="stable")], np.sort(entity)
    _, first, inverse, number = np.unique(
        entity, return_index=True, return_inverse=True, return_counts=True
    )
    place, queried = (
        np.arange(len(rest)) - first[inverse],
        np.maximum(1, (settings.queries * number).astype(int)),
    )
    later = place - queried[inverse]
    inserted = later >= 0
    return HiddenSplit(
        order, known, renamed[ends == 0], rest[inserted], later[inserted], rest[~inserted], renamed
    )
