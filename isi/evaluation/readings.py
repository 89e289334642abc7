"""Readings of "the weighted average MRR* across all queries in D¹" (section 6.1):
which mean over which queries.

The words leave open which triples are queried, about which entities, how a query weighs, which
slots are hidden, what is filtered, and which observations order the true answers. A reading settles
each. All of them are weighted means of the terms of MRR* (equation 7) of every triple of D¹, so a
model is ranked once for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Self, get_args

import torch
from torch import Tensor

from isi.evaluation.ranking import (
    Queries,
    Truth,
    by_relation,
    make_queries,
    observations,
    padded_ids,
    rank_queries,
)
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership, touches
from isi.models.stack import Embedding

#: Choices of each aspect of a reading. Queries: the splits that are queried.
QUERIES = {
    "test": (TEST,),
    "held_out": (VALID, TEST),
    "all": (TRAIN, VALID, TEST),
    "train": (TRAIN,),
}
#: Triples without a novel entity, with one, or any. ``both``: as ``any``, but a run has to converge
#: about known and about novel entities.
ABOUT = ("any", "known", "novel", "both")
#: Each triple alike; or a relation by its observations and its triples alike (a query for a
#: relation weighs as any other one); or each triple by its own observations.
WEIGHTS = ("triple", "relation", "observations")
#: Shares of the queries for a head, a relation and a tail.
SLOTS = {
    "alike": (1 / 3, 1 / 3, 1 / 3),
    "entities": (1 / 2, 0.0, 1 / 2),
    "halves": (1 / 4, 1 / 2, 1 / 4),
}
#: True triples, besides the queried one, that are no candidates: of these splits.
FILTERS = {"learned": (TRAIN, VALID), "true": (TRAIN, VALID, TEST), "none": ()}
TRUTHS: tuple[Truth, ...] = get_args(Truth)
#: Filter and truth: each pair gives a query other ranks.
RANKINGS = tuple(product(FILTERS, TRUTHS))


@dataclass(frozen=True)
class Reading:
    """One reading of the metric: a choice for each aspect."""

    queries: str = "test"
    about: str = "any"
    weights: str = "relation"
    slots: str = "halves"
    filter: str = "learned"
    truth: str = "all"

    @property
    def name(self) -> str:
        """Its choices in order, which `of` reads:
        ``test any relation halves learned all`` is the product's.
        """
        return " ".join(getattr(self, aspect) for aspect in ASPECTS)

    @classmethod
    def of(cls, name: str) -> Self:
        """The reading of a name."""
        return cls(*name.split())

    @property
    def neighbours(self) -> list[Reading]:
        """The readings that differ from this one in a single aspect."""
        return [
            other
            for other in readings()
            if sum(getattr(self, a) != getattr(other, a) for a in ASPECTS) == 1
        ]


#: The choices of each aspect; aspects and choices in the order of ``readings()``.
CHOICES: dict[str, tuple[str, ...]] = {
    "queries": tuple(QUERIES),
    "about": ABOUT,
    "weights": WEIGHTS,
    "slots": tuple(SLOTS),
    "filter": tuple(FILTERS),
    "truth": TRUTHS,
}
ASPECTS = tuple(CHOICES)


@cache
def readings() -> tuple[Reading, ...]:
    """Every reading."""
    return tuple(Reading(*choices) for choices in product(*CHOICES.values()))


def place_of(reading: Reading) -> int:
    """The place of a reading in ``readings()``."""
    place = 0
    for aspect, choices in CHOICES.items():
        place = place * len(choices) + choices.index(getattr(reading, aspect))
    return place


@dataclass(frozen=True)
class ReadingQueries:
    """All triples of D¹ as queries for every reading:
    their ranks' rows by ranking, and their weights.
    """

    rankings: dict[tuple[str, Truth], Queries]
    #: of each group of queries, in its slot head, relation and tail; 0 for other queries; NaN in a
    #: group without queries; shape: (M, G, 3, Q)
    weights: Tensor
    triples: Tensor  #: ids, -1 for padding; shape: (M, Q)


#: Groups of queries: the choices of queries, about and weights.
GROUPS = tuple(product(QUERIES, ABOUT[:3], WEIGHTS))


def reading_queries(session: Session, novel: Tensor) -> ReadingQueries:
    """The queries of D¹ and their weights in each group;
    ``novel``: ids of the novel entities, (M, n).
    """
    graph, is_novel = session.graph, membership(novel, session.entities.shape[1])
    every, new = session.members(TRAIN, VALID, TEST), touches(graph, is_novel)
    triples = padded_ids(every)
    rankings = {}
    for filter_name, truth in RANKINGS:
        splits = FILTERS[filter_name]
        filtered = session.members(*splits) if splits else torch.zeros_like(every)
        rankings[filter_name, truth] = make_queries(
            session, triples, every, filtered, session.entities, truth
        )
    about = {"any": torch.ones_like(new), "known": ~new, "novel": new}
    masks = [session.members(*QUERIES[queries]) & about[which] for queries, which, _ in GROUPS]
    weights = [
        _weights(session, mask, kind) for mask, (*_, kind) in zip(masks, GROUPS, strict=True)
    ]
    padding, places = (triples < 0)[:, None, None], triples.clamp(min=0)[:, None, None]
    of_queries = torch.stack(weights, 1).gather(-1, places.expand(-1, len(GROUPS), 3, -1))
    return ReadingQueries(
        rankings, of_queries.masked_fill(padding & ~of_queries.isnan(), 0), triples
    )


def _weights(session: Session, queried: Tensor, kind: str) -> Tensor:
    """Weight of each triple as a query for its head, relation and tail, which sum to 1 by slot;
    shape: (M, 3, T).
    """
    graph = session.graph
    alike = queried.double()
    if kind == "observations":
        entity = relation = alike * graph.counts
    elif kind == "relation":
        shares = observations(session).double() / by_relation(graph, queried).clamp(min=1)
        entity, relation = alike * shares[:, graph.triples[:, 1]], alike
    else:
        entity = relation = alike
    weights = torch.stack([entity, relation, entity], 1)
    return weights / _total(weights)[..., None]  # NaN without queries


def _total(terms: Tensor) -> Tensor:
    """The sum over the last dimension in order,
    so that neither padding nor the height of a stack changes a bit.
    """
    return terms.cumsum(-1)[..., -1]


@dataclass(frozen=True)
class QueryRanks:
    """Ranks of all queries of D¹ by ranking, filter and truth; shapes: (M, 6, 3, Q);
    slots: head, relation, tail.
    """

    closeness: Tensor  #: the term of MRR*
    rank: Tensor  #: the plain rank


def rank_all(embedding: Embedding, queries: ReadingQueries) -> QueryRanks:
    """Rank every query of D¹ under each filter and truth."""
    closeness, rank = list[Tensor](), list[Tensor]()
    for piece in rank_queries(embedding, queries.rankings):
        slots = [ranked.slots for ranked in piece.values()]
        closeness.append(
            torch.stack([torch.stack([ranks.closeness for ranks in of], 1) for of in slots], 1)
        )
        rank.append(torch.stack([torch.stack([ranks.rank for ranks in of], 1) for of in slots], 1))
    return QueryRanks(torch.cat(closeness, -1), torch.cat(rank, -1))


def values(ranks: QueryRanks, queries: ReadingQueries) -> Tensor:
    """MRR* under every reading, in the order of ``readings()``; NaN without queries;
    shape: (M, readings).
    """
    closeness, shares = (
        ranks.closeness.double(),
        torch.tensor(list(SLOTS.values()), dtype=torch.float64),
    )
    by_ranking = [
        _total(queries.weights * closeness[:, place, None]) for place in range(len(RANKINGS))
    ]
    # (M, G, choices of slots, rankings)
    means = _total(torch.stack(by_ranking, 2)[:, :, None] * shares[:, None])
    models, groups = len(means), [len(QUERIES), 3, len(WEIGHTS)]
    means = means.reshape(models, *groups, len(SLOTS), len(RANKINGS))
    both = means[:, :, :1]  # the value of "both" is that of "any"
    return torch.cat([means, both], 2).reshape(models, -1)


def reached(measured: Tensor, target: Tensor) -> Tensor:
    """Where MRR* is at its target or above; NaN: never; shapes: (M, readings).

    "both" needs known and novel, or the one of them that has queries.
    """
    shape = len(measured), len(QUERIES), len(ABOUT), -1
    is_reached, absent = (measured >= target).reshape(shape), target.isnan().reshape(shape)
    fulfilled = is_reached | absent
    is_reached[:, :, 3] = fulfilled[:, :, 1] & fulfilled[:, :, 2]
    return is_reached.reshape(measured.shape)


def places_of(names: Sequence[str]) -> list[int]:
    """Places in ``readings()`` of the readings with these names."""
    return [place_of(Reading.of(name)) for name in names]
