"""Which entities of a graph are hidden, and which of their triples are facts or queries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL


@dataclass(frozen=True, eq=False)
class SplitIds:
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


def split_ids(
    triples: np.ndarray,
    entities: int,
    number: int,
    fewest: int,
    queries: float,
    rng: np.random.Generator,
) -> SplitIds:
    """Hide random entities of a graph of ``entities`` entities and ``triples``, ids (N, 3).

    Args:
        number: of entities that are hidden.
        fewest: minimum number of triples of a hidden entity with a known one, at least 2.
        queries: share of those triples that become queries, rounded down, at least one triple.
    """
    hidden = hidden_mask(triples, rng.permutation(entities), number, fewest)
    order, known = np.argsort(hidden, kind="stable"), int((~hidden).sum())
    renamed = triples.copy()
    renamed[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
    ends = (renamed[:, [HEAD, TAIL]] >= known).sum(1)
    rest = rng.permutation(renamed[ends == 1])
    # the hidden end: hidden entities have higher ids than known ones
    entity = rest[:, [HEAD, TAIL]].max(1)
    rest, entity = rest[np.argsort(entity, kind="stable")], np.sort(entity)
    _, first, inverse, counts = np.unique(
        entity, return_index=True, return_inverse=True, return_counts=True
    )
    place = np.arange(len(rest)) - first[inverse]
    queried = np.maximum(1, (queries * counts).astype(int))
    later = place - queried[inverse]
    is_fact = later >= 0
    return SplitIds(
        order, known, renamed[ends == 0], rest[is_fact], later[is_fact], rest[~is_fact], renamed
    )


def hidden_mask(triples: np.ndarray, order: np.ndarray, number: int, fewest: int) -> np.ndarray:
    """Mask, (E,), of the first ``number`` entities in ``order``, (E,), that can be hidden together:
    all others and all relations keep a triple of known ones, and each hidden entity has at least
    ``fewest`` triples with a known one. InputError if there are too few.

    Each step looks only at the triples of its entity.
    """
    ends, relation = triples[:, [HEAD, TAIL]], triples[:, RELATION]
    flat = ends.flatten()
    by_entity = np.argsort(flat, kind="stable") // 2  # triples, sorted by entity
    first = np.searchsorted(np.sort(flat), np.arange(len(order) + 1))
    hidden = np.zeros(len(order), dtype=bool)
    inner = np.bincount(flat, minlength=len(order))  # by entity: ends in triples of known ones
    outer = np.zeros(len(order), dtype=np.int64)  # by hidden entity: triples with a known one
    of_relation = np.bincount(relation)  # by relation: triples of known entities
    has_triples = bool(inner.all())
    for entity in order if has_triples else ():
        about = np.unique(by_entity[first[entity] : first[entity + 1]])
        others = ends[about].sum(1) - entity
        is_loop, is_outer = others == entity, hidden[others]
        neighbours, lost = np.unique(others[~is_outer & ~is_loop], return_counts=True)
        partners, shared = np.unique(others[is_outer], return_counts=True)
        relations, fewer = np.unique(relation[about[~is_outer]], return_counts=True)
        if (
            lost.sum() >= fewest
            and (inner[neighbours] > lost).all()
            and (of_relation[relations] > fewer).all()
            and (outer[partners] - shared >= fewest).all()
        ):
            hidden[entity] = True
            outer[entity] = lost.sum()
            inner[neighbours] -= lost
            outer[partners] -= shared
            of_relation[relations] -= fewer
        if hidden.sum() == number:
            return hidden
    raise InputError("", "", "expected fewer hidden entities: too few triples are left")
