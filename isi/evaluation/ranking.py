"""Filtered ranks and MRR* (equation 7).

A query hides one slot of a triple. Its candidates are the entities of the session
(or the relations), except those that make a triple of the filter. The true answer always stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.ranks import parts, scores_of, wins
from isi.graph.graph import RELATION, Graph
from isi.graph.sessions import TRAIN, Session
from isi.models.stack import Embedding

if TYPE_CHECKING:
    import pandas as pd

MEASURES = ("mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr")

#: Which observations order the true answers of a query. ``all``: those of the graph. ``split``:
#: those of the split of the queried triple, where a training triple counts all its observations and
#: any other one counts once.
Truth = Literal["all", "split"]
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
    #: 1 for each candidate of ``known`` left out of the plain rank; shape: (M, Q, X), float32
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
    #: share of head queries, then of tail queries, in ``mrr_star_entity``; shape: (M, 2Q)
    entity_weight: Tensor
    relation_weight: Tensor  #: share of a relation query in ``mrr_star_relation``; shape: (M, Q)

    @property
    def ids(self) -> list[Tensor]:
        """Ids of head, relation and tail; shapes: (M, Q)."""
        return [competitors.answer for competitors in self.slots]


@dataclass(frozen=True)
class Queries:
    """A query set of a stack of sessions: triples with their filter and candidates."""

    session: Session
    triples: Tensor  #: ids of the triples that have a row, -1 for padding; shape: (M, Q)
    queried: Tensor  #: triples that are queried; shape: (M, T), bool
    filtered: Tensor  #: triples of the filter; shape: (M, T), bool
    candidates: Tensor  #: entities that may answer; shape: (M, E), bool
    truth: Truth = "all"
    #: computed once if they fit into ``BUDGET``, else by piece in each ranking
    rows: QueryRows | None = None


@dataclass(frozen=True)
class Ranks:
    """Ranks of the answers of the queries that hide one slot; shapes: (M, Q)."""

    closeness: Tensor  #: 1 / (|R_G - R_P| + 1), the term of MRR* (equation 7)
    rank: Tensor  #: the plain rank
    tied: Tensor  #: number of competitors tied with the answer in R_P


@dataclass(frozen=True)
class RankedQueries:
    """Queries and the ranks of their answers: heads, relations and tails."""

    rows: QueryRows
    slots: list[Ranks]


@dataclass(frozen=True)
class Result:
    """Measures of each model of a stack; NaN where it has no queries."""

    measures: Tensor  #: in the order of ``MEASURES``; shape: (M, 4), float64
    queries: Tensor  #: number of queried triples; shape: (M,)
    ties: Tensor  #: number of competitors tied with the answer in R_P; shape: (M,)


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
        counts = {"queries": result.queries.cpu().numpy(), "ties": result.ties.cpu().numpy()}
        places = np.arange(len(result.queries)) if models is None else models.cpu().numpy()
        frames.append(
            pd.DataFrame({**columns, **counts, "place": places, "epoch": epoch, "scope": scope})
        )
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
    candidates: Tensor,
    truth: Truth = "all",
) -> Queries:
    """A query set; its ``rows`` are computed here if all scores fit into ``BUDGET``, else None;
    shapes: ``Queries``.
    """
    queries = Queries(session, triples, queried, filtered, candidates, truth)
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
        _competitors(queries, ids, slot, listed) for slot, listed in enumerate(candidates)
    )
    counted = (triples >= 0) & queries.queried.gather(1, ids)
    # weight of a query: its relation's share of observations, divided by the relation's number of
    # queries
    number = by_relation(session.graph, queries.queried)
    observed = observations(session) * (number > 0)
    shares = observed / observed.sum(1, keepdim=True).clamp(min=1) / number.clamp(min=1)
    entity_weight = torch.cat([shares.gather(1, relation.answer) * counted] * 2, 1) / 2
    return QueryRows(
        (head, relation, tail), entity_weight, counted / number.sum(1, keepdim=True).clamp(min=1)
    )


def _competitors(queries: Queries, triple: Tensor, slot: int, candidates: Tensor) -> Competitors:
    """Competitors of the queries that hide one slot of triples, ids (M, Q)."""
    graph = queries.session.graph
    alike = graph.same_but(slot, triple)  # (M, Q, X)
    ids = alike.clamp(min=0)
    known, answer = graph.triples[:, slot][ids], graph.triples[:, slot][triple]
    models = torch.arange(len(triple))[:, None, None]
    may_answer = candidates[models, known] & (alike >= 0)
    counts, answer_count = graph.counts[ids], graph.counts[triple][..., None]
    if queries.truth == "split":
        splits = queries.session.splits
        split, answer_split = splits[models, ids], splits[models[..., 0], triple][..., None]
        counts = torch.where(split == TRAIN, counts, 1) * (split == answer_split)
        answer_count = torch.where(answer_split == TRAIN, answer_count, 1)
    excluded = queries.filtered[models, ids] | (ids == triple[..., None])
    higher = (may_answer & ~excluded & (counts > answer_count)).sum(-1)
    left_out = (
        (may_answer & excluded).float(),
        (may_answer & (excluded | (counts == answer_count))).float(),
    )
    return Competitors(candidates.float(), answer, known, *left_out, 1 + higher)


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
    sums = [
        {name: _measure(ranked) for name, ranked in piece.items()}
        for piece in rank_queries(embedding, query_sets)
    ]
    results = {}
    for name, queries in query_sets.items():
        measures, ties = (
            torch.stack(values).sum(0)
            for values in zip(*(part[name] for part in sums), strict=True)
        )
        number = queries.queried.sum(1)
        results[name] = Result(
            measures.masked_fill((number == 0)[:, None], torch.nan), number, ties.long()
        )
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
    total, all_tied = (won @ everyone)[..., 0], ((won == 0.5).float() @ everyone)[..., 0]
    predicted_rank = 1 + total - (known * competitors.excluded_or_equal).sum(-1)
    rank = 1 + total - (known * competitors.excluded).sum(-1)
    tied = all_tied - ((known == 0.5) * competitors.excluded_or_equal).sum(-1)
    return Ranks(1 / ((competitors.true_rank - predicted_rank).abs() + 1), rank, tied)


def _measure(ranked: RankedQueries) -> tuple[Tensor, Tensor]:
    """Contribution of a piece to measures, (M, 4), and ties, (M,);
    summed in order, so padding changes no bit.
    """
    (head, relation, tail), star, plain = ranked.slots, [], []
    ties = torch.zeros(len(head.rank))
    for weight, slots in (
        (ranked.rows.entity_weight, (head, tail)),
        (ranked.rows.relation_weight, (relation,)),
    ):
        star.append(
            (weight * torch.cat([ranks.closeness for ranks in slots], 1)).double().cumsum(1)[:, -1]
        )
        plain.append(
            (weight / torch.cat([ranks.rank for ranks in slots], 1)).double().cumsum(1)[:, -1]
        )
        ties += (torch.cat([ranks.tied for ranks in slots], 1) * (weight > 0)).sum(1)
    return torch.stack([sum(star) / 2, *star, sum(plain) / 2], 1), ties  # type: ignore[list-item]
