"""Filtered ranks, MRR, and MRR* (equation 7).

A query hides one slot of a triple. Its candidates are the entities of the session
(or the relations), except those that make a triple of the filter. The true answer always stays.

MRR leaves out every other true triple. MRR* has a filter of its own, and compares the rank by
score with the rank by number of observations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.ranks import parts, scores_of, wins
from isi.graph.graph import RELATION, Graph
from isi.graph.sessions import Session
from isi.models.stack import Embedding

if TYPE_CHECKING:
    import pandas as pd

#: Each with its halves: entity prediction and relation prediction.
MEASURES = (
    *("mrr_star", "mrr_star_entity", "mrr_star_relation"),
    *("mrr", "mrr_entity", "mrr_relation"),
)
K = TypeVar("K")


@dataclass(frozen=True)
class Competitors:
    """The candidates of queries that hide one slot:
    entities (or relations), minus other answers in the filter.
    """

    candidates: Tensor  #: shape: (M, C), float32 of 0 and 1
    answer: Tensor  #: ids; shape: (M, Q)
    #: ids of all answers to each query in the graph's triples, padded to X; shape: (M, Q, X)
    known: Tensor
    #: 1 for each candidate of ``known`` left out of the rank of MRR; shape: (M, Q, X), float32
    excluded: Tensor
    #: the same for R_P, a rank by score without candidates of equal count; shape: (M, Q, X)
    excluded_or_equal: Tensor
    true_rank: Tensor  #: R_G, the answer's rank by number of observations; shape: (M, Q)


@dataclass(frozen=True)
class QueryRows:
    """Queried triples, and the data for ranking except scores; each slot is hidden in turn;
    padding has weight 0.
    """

    #: of the queries (?, r, t), (h, ?, t) and (h, r, ?)
    slots: tuple[Competitors, Competitors, Competitors]
    #: share of head queries, then of tail queries, in entity prediction; shape: (M, 2Q)
    entity_weight: Tensor
    relation_weight: Tensor  #: share of a relation query in relation prediction; shape: (M, Q)
    times: Tensor  #: how often each triple is queried, 0 for padding; shape: (M, Q), int64

    @property
    def ids(self) -> list[Tensor]:
        """Ids of head, relation and tail; shapes: (M, Q)."""
        return [competitors.answer for competitors in self.slots]


@dataclass(frozen=True)
class Queries:
    """A query set of a stack of sessions: triples with their filter and candidates."""

    session: Session
    triples: Tensor  #: ids of the triples that have a row, -1 for padding; shape: (M, Q)
    queried: Tensor  #: how often each triple is queried; shape: (M, T), int64
    filtered: Tensor  #: triples of the filter of MRR*; shape: (M, T), bool
    true: Tensor  #: triples of the filter of MRR; shape: (M, T), bool
    candidates: Tensor  #: entities that may answer; shape: (M, E), bool
    #: whether each query for an entity weighs alike, not each relation by its observations
    alike: bool = False
    #: computed once if they fit into ``BUDGET``, else by piece in each ranking
    rows: QueryRows | None = None


@dataclass(frozen=True)
class Ranks:
    """Ranks of the answers of the queries that hide one slot; shapes: (M, Q)."""

    closeness: Tensor  #: 1 / (|R_G - R_P| + 1), the term of MRR* (equation 7)
    rank: Tensor  #: the rank of MRR


@dataclass(frozen=True)
class RankedQueries:
    """Queries and the ranks of their answers: heads, relations and tails."""

    rows: QueryRows
    slots: list[Ranks]


@dataclass(frozen=True)
class Result:
    """Measures of each model of a stack; NaN where it has no queries."""

    measures: Tensor  #: in the order of ``MEASURES``; shape: (M, 6), float64
    queries: Tensor  #: number of queried triples, each counted once; shape: (M,)


def measure_rows(
    results: Mapping[str, Result], epoch: int = 0, models: Tensor | None = None
) -> pd.DataFrame:
    """A row of measures for each query set and model;
    ``models`` are their places in the stack, None: all.
    """
    import pandas as pd

    frames = []
    for scope, result in results.items():
        columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
        columns["queries"] = result.queries.cpu().numpy()
        places = np.arange(len(result.queries)) if models is None else models.cpu().numpy()
        frames.append(pd.DataFrame({**columns, "place": places, "epoch": epoch, "scope": scope}))
    return pd.concat(frames)


def padded_ids(queried: Tensor) -> Tensor:
    """Ids of the triples in a mask, (M, T), padded with -1 to the longest row; shape (M, Q)."""
    longest = max(1, int(queried.sum(1).max()))
    order = torch.sort((~queried).to(torch.int8), dim=1, stable=True).indices[:, :longest]
    return torch.where(queried.gather(1, order), order, -1)


def make_queries(
    session: Session,
    triples: Tensor,
    queried: Tensor,
    filtered: Tensor,
    true: Tensor,
    candidates: Tensor,
    alike: bool = False,
) -> Queries:
    """A query set; its ``rows`` are computed here if all scores fit into ``BUDGET``, else None;
    shapes: ``Queries``; ``queried`` may be a mask.
    """
    queries = Queries(session, triples, queried.long(), filtered, true, candidates, alike)
    return replace(queries, rows=_rows(queries, triples)) if len(_pieces(queries)) == 1 else queries


def _pieces(queries: Queries) -> tuple[Tensor, ...]:
    """The triples in pieces, such that the scores of heads and of tails, (M, Q, E) each,
    fit into ``BUDGET``.
    """
    models, entities = queries.candidates.shape
    return parts(queries.triples, 2 * models * entities, 1)


def _rows(queries: Queries, triples: Tensor) -> QueryRows:
    session, ids = queries.session, triples.clamp(min=0)
    all_relations = torch.ones(len(triples), len(session.graph.relations), dtype=torch.bool)
    candidates = (queries.candidates, all_relations, queries.candidates)
    head, relation, tail = (
        _competitors(queries, ids, slot, of_slot) for slot, of_slot in enumerate(candidates)
    )
    times = queries.queried.gather(1, ids).masked_fill(triples < 0, 0)
    # weight of a query: its relation's share of observations, divided by the relation's number of
    # queries
    number = by_relation(session.graph, queries.queried)
    total = number.sum(1, keepdim=True).clamp(min=1)
    observed = observations(session) * (number > 0)
    shares = observed / observed.sum(1, keepdim=True).clamp(min=1) / number.clamp(min=1)
    of_triple = 1 / total if queries.alike else shares.gather(1, relation.answer)
    entity_weight = torch.cat([of_triple * times] * 2, 1) / 2
    return QueryRows((head, relation, tail), entity_weight, times / total, times)


def _competitors(queries: Queries, triple: Tensor, slot: int, candidates: Tensor) -> Competitors:
    """Competitors of the queries that hide one slot of triples, ids (M, Q)."""
    graph = queries.session.graph
    alike = graph.same_but(slot, triple)  # (M, Q, X)
    ids = alike.clamp(min=0)
    known, answer = graph.triples[:, slot][ids], graph.triples[:, slot][triple]
    models = torch.arange(len(triple))[:, None, None]
    may_answer = candidates[models, known] & (alike >= 0)
    is_answer = ids == triple[..., None]
    counts, answer_count = graph.counts[ids], graph.counts[triple][..., None]
    not_true = ~(queries.true[models, ids] | is_answer)
    left = ~(queries.filtered[models, ids] | is_answer)
    higher = (may_answer & left & (counts > answer_count)).sum(-1)
    return Competitors(
        candidates=candidates.float(),
        answer=answer,
        known=known,
        excluded=(may_answer & ~not_true).float(),
        excluded_or_equal=(may_answer & (~left | (counts == answer_count))).float(),
        true_rank=1 + higher,
    )


def observations(session: Session) -> Tensor:
    """Number of observations of each relation in a session: its weight in equation 7;
    shape (M, R), int64.
    """
    return by_relation(session.graph, (session.splits >= 0) * session.graph.counts)


def by_relation(graph: Graph, values: Tensor) -> Tensor:
    """Sum values of unique triples, (M, T), by relation; shape (M, R), int64."""
    totals = torch.zeros(len(values), len(graph.relations), dtype=torch.int64)
    return totals.index_add_(1, graph.triples[:, RELATION], values.long())


def evaluate(embedding: Embedding, query_sets: Mapping[str, Queries]) -> dict[str, Result]:
    """Measures over query sets with the same ``Queries.triples``."""
    sums = dict[str, Tensor]()
    for piece in rank_queries(embedding, query_sets):
        for name, ranked in piece.items():
            part = _measure(ranked)
            sums[name] = sums[name] + part if name in sums else part
    results = {}
    for name, queries in query_sets.items():
        number = (queries.queried > 0).sum(1)
        results[name] = Result(sums[name].masked_fill((number == 0)[:, None], torch.nan), number)
    return results


def rank_queries(
    embedding: Embedding, query_sets: Mapping[K, Queries]
) -> Iterator[dict[K, RankedQueries]]:
    """Ranks of each query of query sets with the same ``Queries.triples``, piece by piece."""
    for piece in _pieces(next(iter(query_sets.values()))):
        rows = {name: queries.rows or _rows(queries, piece) for name, queries in query_sets.items()}
        head, relation, tail = ids = next(iter(rows.values())).ids
        scores = (
            embedding.score_heads(relation, tail),
            embedding.score_relations(head, tail),
            embedding.score_tails(head, relation),
        )
        won = [
            wins(of_slot, scores_of(answer, of_slot), "gap") / 2
            for of_slot, answer in zip(scores, ids, strict=True)
        ]
        yield {
            name: RankedQueries(queries, list(map(_ranks, won, queries.slots)))
            for name, queries in rows.items()
        }


def _ranks(won: Tensor, competitors: Competitors) -> Ranks:
    """Ranks of the answers from ``wins``."""
    known, everyone = won.gather(-1, competitors.known), competitors.candidates[..., None]
    total = (won @ everyone)[..., 0]
    predicted_rank = 1 + total - (known * competitors.excluded_or_equal).sum(-1)
    rank = 1 + total - (known * competitors.excluded).sum(-1)
    return Ranks(1 / ((competitors.true_rank - predicted_rank).abs() + 1), rank)


def _measure(ranked: RankedQueries) -> Tensor:
    """Contribution of a piece to the measures, (M, 6);
    summed in order, so padding changes no bit.
    """
    head, relation, tail = ranked.slots
    star, plain = list[Tensor](), list[Tensor]()
    for weight, slots in (
        (ranked.rows.entity_weight, (head, tail)),
        (ranked.rows.relation_weight, (relation,)),
    ):
        closeness = torch.cat([ranks.closeness for ranks in slots], 1)
        rank = torch.cat([ranks.rank for ranks in slots], 1)
        star.append((weight * closeness).double().cumsum(1)[:, -1])
        plain.append((weight / rank).double().cumsum(1)[:, -1])
    halves = [(sum(half) / 2, *half) for half in (star, plain)]
    return torch.stack([*halves[0], *halves[1]], 1)  # type: ignore[list-item]
