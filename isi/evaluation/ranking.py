"""Filtered ranks and MRR* (equation 7).

A query hides one slot of a triple. Its candidates are the entities of the session (or the
relations), except those that make a triple of the filter. The true answer always stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import torch
from torch import Tensor
from torch.nn.functional import pad

from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sessions import Session
from isi.models.stack import Embedding

#: Scores closer to the answer's than this times the largest magnitude in their row are tied.
TIE = 1e-5
#: Numbers in one score matrix, at most: more queries are ranked in pieces.
BUDGET = 2**24
MEASURES = ("mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr")

K = TypeVar("K")


@dataclass(frozen=True)
class Competitors:
    """Candidates that compete with the answers of queries: all candidates minus some known answers."""

    candidates: Tensor  #: shape: (M, C), float32 of 0 and 1
    known: Tensor  #: ids of the answers that the graph's triples give to each query, padded to X; shape: (M, Q, X)
    excluded: Tensor  #: which of these are candidates left out of the plain rank; shape: (M, Q, X), float32 of 0 and 1
    #: the same for R_P, which leaves out equal counts, too; shape: (M, Q, X), float32 of 0 and 1
    excluded_or_equal: Tensor
    true_rank: Tensor  #: R_G; shape: (M, Q)


@dataclass(frozen=True)
class QueryRows:
    """Queries with all that does not depend on scores; models with fewer have rows of weight zero."""

    #: ids of head, relation and tail; shapes: (M, Q)
    head: Tensor
    relation: Tensor
    tail: Tensor
    entity: Competitors  #: of the head queries (?, r, t), then the tail queries (h, r, ?): 2Q rows
    relations: Competitors  #: of the relation queries (h, ?, t)
    entity_weight: Tensor  #: share of each entity query in ``mrr_star_entity``; shape: (M, 2Q)
    relation_weight: Tensor  #: share of each relation query; shape: (M, Q)


@dataclass(frozen=True)
class Queries:
    """A query set of a stack of sessions: triples with their filter and candidates."""

    session: Session
    triples: Tensor  #: ids of the triples that have a row, -1 for padding; shape: (M, Q)
    queried: Tensor  #: triples that are queried; shape: (M, T), bool
    filtered: Tensor  #: triples of the filter; shape: (M, T), bool
    candidates: Tensor  #: entities that may answer; shape: (M, E), bool
    rows: QueryRows | None  #: made once where they fit into ``BUDGET``, else piece by piece in each ranking


@dataclass(frozen=True)
class Ranks:
    """Ranks of the answers of queries; shapes: (M, Q)."""

    closeness: Tensor  #: 1 / (|R_G - R_P| + 1)
    rank: Tensor  #: the plain rank
    tied: Tensor  #: competitors tied with the answer in R_P


@dataclass(frozen=True)
class RankedQueries:
    """Queries and the ranks of their answers."""

    rows: QueryRows
    entity: Ranks  #: of the head queries, then the tail queries; 2Q columns
    relations: Ranks


@dataclass(frozen=True)
class Result:
    """Measures of a stack; NaN where a model has no queries."""

    measures: Tensor  #: in the order of ``MEASURES``; shape: (M, 4), float64
    queries: Tensor  #: queried triples; shape: (M,)
    ties: Tensor  #: competitors tied with the answer in R_P; shape: (M,)


def padded_ids(queried: Tensor) -> Tensor:
    """Triple ids of a mask of shape (M, T), padded with -1 to the longest row; shape (M, Q)."""
    longest = max(1, int(queried.sum(1).max()))
    order = torch.sort((~queried).to(torch.int8), dim=1, stable=True).indices[:, :longest]
    return torch.where(queried.gather(1, order), order, -1)


def make_queries(session: Session, triples: Tensor, queried: Tensor, filtered: Tensor, candidates: Tensor) -> Queries:
    """A query set, with its rows where these fit into ``BUDGET`` (see ``Queries``)."""
    queries = Queries(session, triples, queried, filtered, candidates, None)
    return replace(queries, rows=_rows(queries, triples)) if len(_pieces(queries)) == 1 else queries


def _pieces(queries: Queries) -> tuple[Tensor, ...]:
    """The triples in pieces whose score matrices, (M, 2Q, E), fit into ``BUDGET``."""
    models, entities = queries.candidates.shape
    return torch.split(queries.triples, max(1, BUDGET // (2 * models * entities)), 1)


def _rows(queries: Queries, triples: Tensor) -> QueryRows:
    graph, ids = queries.session.graph, triples.clamp(min=0)
    head, relation, tail = graph.triples[ids].unbind(-1)
    heads, tails = (_competitors(queries, ids, slot, queries.candidates) for slot in (HEAD, TAIL))
    all_relations = torch.ones(len(triples), len(graph.relations), dtype=torch.bool)
    counted = (triples >= 0) & queries.queried.gather(1, ids)
    shares = _relation_shares(queries.session, queries.queried).gather(1, relation) * counted
    number = queries.queried.sum(1, keepdim=True).clamp(min=1)
    return QueryRows(
        head, relation, tail, _joined(heads, tails), _competitors(queries, ids, RELATION, all_relations),
        torch.cat([shares, shares], 1) / 2, counted / number,
    )  # fmt: skip


def _competitors(queries: Queries, triple: Tensor, slot: int, candidates: Tensor) -> Competitors:
    """Competitors of the queries that hide one slot of triples, (M, Q)."""
    graph = queries.session.graph
    alike = graph.same_but(slot, triple)  # (M, Q, X)
    ids = alike.clamp(min=0)
    known = graph.triples[:, slot][ids]
    models = torch.arange(len(triple))[:, None, None]
    may_answer = candidates[models, known] & (alike >= 0)
    counts, answer_count = graph.counts[ids], graph.counts[triple][..., None]
    excluded = queries.filtered[models, ids] | (ids == triple[..., None])
    higher = (may_answer & ~excluded & (counts > answer_count)).sum(-1)
    excluded_or_equal = may_answer & (excluded | (counts == answer_count))
    return Competitors(
        candidates.float(), known, (may_answer & excluded).float(), excluded_or_equal.float(), 1 + higher
    )


def _joined(heads: Competitors, tails: Competitors) -> Competitors:
    """Head queries, then tail queries, padded to the same number of known answers."""
    longest = max(heads.known.shape[-1], tails.known.shape[-1])

    def joined(*parts: Tensor) -> Tensor:
        return torch.cat([pad(part, (0, longest - part.shape[-1])) for part in parts], 1)

    return Competitors(
        heads.candidates, joined(heads.known, tails.known), joined(heads.excluded, tails.excluded),
        joined(heads.excluded_or_equal, tails.excluded_or_equal), torch.cat([heads.true_rank, tails.true_rank], 1),
    )  # fmt: skip


def _relation_shares(session: Session, queried: Tensor) -> Tensor:
    """Weight of a query by its relation: the relation's share of observations over its queries; (M, R)."""
    queries = by_relation(session.graph, queried)
    observed = observations(session) * (queries > 0)
    return observed / observed.sum(1, keepdim=True).clamp(min=1) / queries.clamp(min=1)


def observations(session: Session) -> Tensor:
    """Observations of each relation in a session, its weight in equation 7; shape (M, R), int64."""
    return by_relation(session.graph, (session.splits >= 0) * session.graph.counts)


def by_relation(graph: Graph, values: Tensor) -> Tensor:
    """Sums by relation of values of unique triples, (M, T); shape (M, R), int64."""
    totals = torch.zeros(len(values), len(graph.relations), dtype=torch.int64)
    return totals.index_add_(1, graph.triples[:, RELATION], values.long())


def compare(scores: Tensor, answer: Tensor) -> Tensor:
    """By candidate: 1 where it scores above the answer, ½ where they are tied, else 0; shape (M, Q, C).

    ``answer`` is the index of each answer in its row of scores; shapes (M, Q), (M, Q, C).
    """
    ahead = scores - scores.gather(-1, answer[..., None])
    tie = TIE * scores.abs().amax(-1, keepdim=True)
    return ((ahead > tie).float() + ~(ahead < -tie)) / 2  # NaN is tied with everything: a diverged model is at chance


def evaluate(embedding: Embedding, query_sets: Mapping[str, Queries]) -> dict[str, Result]:
    """Measures over query sets that share their rows (``Queries.triples`` are the same)."""
    sums: dict[str, list[tuple[Tensor, Tensor]]] = {name: [] for name in query_sets}
    for piece in rank_queries(embedding, query_sets):
        for name, ranked in piece.items():
            sums[name].append(_measure(ranked))
    return {name: _result(query_sets[name], parts) for name, parts in sums.items()}


def rank_queries(embedding: Embedding, query_sets: Mapping[K, Queries]) -> Iterator[dict[K, RankedQueries]]:
    """Ranks of each query of query sets that share their rows, piece by piece."""
    for piece in _pieces(next(iter(query_sets.values()))):
        rows = {name: queries.rows or _rows(queries, piece) for name, queries in query_sets.items()}
        shared = next(iter(rows.values()))
        heads = embedding.score_heads(shared.relation, shared.tail)
        tails = embedding.score_tails(shared.head, shared.relation)
        entity = compare(torch.cat([heads, tails], 1), torch.cat([shared.head, shared.tail], 1))
        relations = compare(embedding.score_relations(shared.head, shared.tail), shared.relation)
        yield {
            name: RankedQueries(queries, _ranks(entity, queries.entity), _ranks(relations, queries.relations))
            for name, queries in rows.items()
        }


def _ranks(ahead: Tensor, competitors: Competitors) -> Ranks:
    """Ranks of answers by which candidates are ahead (see ``compare``)."""
    known = ahead.gather(-1, competitors.known)
    total = _over_candidates(ahead, competitors)
    predicted_rank = 1 + total - (known * competitors.excluded_or_equal).sum(-1)
    rank = 1 + total - (known * competitors.excluded).sum(-1)
    all_tied = _over_candidates((ahead == 0.5).float(), competitors)
    tied = all_tied - ((known == 0.5) * competitors.excluded_or_equal).sum(-1)
    return Ranks(closeness(competitors.true_rank, predicted_rank), rank, tied)


def _over_candidates(values: Tensor, competitors: Competitors) -> Tensor:
    """Sum of values, (M, Q, C), over the candidates; exact, since they are halves; (M, Q)."""
    return (values @ competitors.candidates[..., None])[..., 0]


def closeness(true_rank: Tensor, predicted_rank: Tensor) -> Tensor:
    """The term of MRR*: 1 / (|R_G - R_P| + 1) (equation 7)."""
    return 1 / ((true_rank - predicted_rank).abs() + 1)


def _measure(ranked: RankedQueries) -> tuple[Tensor, Tensor]:
    """Share of some queries in the measures, (M, 4), and their ties, (M,)."""
    star, plain, rows = [], [], ranked.rows
    ties = torch.zeros(len(rows.head))
    for ranks, weight in ((ranked.entity, rows.entity_weight), (ranked.relations, rows.relation_weight)):
        star.append(_sum(weight * ranks.closeness))
        plain.append(_sum(weight / ranks.rank))
        ties += (ranks.tied * (weight > 0)).sum(1)
    return torch.stack([sum(star) / 2, *star, sum(plain) / 2], 1), ties  # type: ignore[list-item]


def _sum(terms: Tensor) -> Tensor:
    """Sum of float32 over queries, in order, so that padding with zeros changes no bit; (M, Q), result (M,)."""
    return terms.double().cumsum(1)[:, -1]


def _result(queries: Queries, parts: list[tuple[Tensor, Tensor]]) -> Result:
    measures, ties = (torch.stack(values).sum(0) for values in zip(*parts, strict=True))
    number = queries.queried.sum(1)
    return Result(measures.masked_fill((number == 0)[:, None], torch.nan), number, ties.long())
