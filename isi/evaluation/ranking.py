"""Filtered ranks and MRR* (equation 7).

A query hides one slot of a triple. Its candidates are the entities of the session (or the
relations), except those that make a triple of the filter; the true answer always stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sessions import Session
from isi.models import bits
from isi.models.stack import Embedding

#: Scores closer to the answer's than this times the largest magnitude in their row are tied.
TIE = 1e-5
#: Numbers in one score matrix, at most: more queries are queried in pieces.
BUDGET = 2**24
MEASURES = ("mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr")

K = TypeVar("K")


@dataclass(frozen=True)
class Competitors:
    """Who competes with the answers of queries: all candidates, less some answers of known triples."""

    #: who may answer; shape: (M, C), float32 of 0 and 1
    candidates: Tensor
    #: the answers that the graph's triples give to each query, padded to X; ids, shape: (M, Q, X)
    listed: Tensor
    #: of these, the candidates that are no rivals in the plain rank; shape: (M, Q, X), float32 of 0 and 1
    barred: Tensor
    #: and those that are none in R_P, since their count equals the answer's, too; shape: (M, Q, X)
    equal: Tensor
    #: R_G; shape: (M, Q)
    true_rank: Tensor


@dataclass(frozen=True)
class Rows:
    """Queries with all that does not depend on scores; models with fewer have rows of weight zero."""

    #: ids of head, relation and tail; shapes: (M, Q)
    head: Tensor
    relation: Tensor
    tail: Tensor
    #: of the head queries (?, r, t), then the tail queries (h, r, ?): 2Q rows
    entity: Competitors
    #: of the relation queries (h, ?, t)
    relations: Competitors
    #: share of each entity query in ``mrr_star_entity``; shape: (M, 2Q)
    entity_weight: Tensor
    #: share of each relation query; shape: (M, Q)
    relation_weight: Tensor


@dataclass(frozen=True)
class Queries:
    """The triples that a stack of sessions is queried about in one scope, and how."""

    session: Session
    #: ids of the triples that have a row, -1 for padding; shape: (M, Q)
    slots: Tensor
    #: triples that are queried about; shape: (M, T), bool
    queried: Tensor
    #: triples that are left out as rivals; shape: (M, T), bool
    filtered: Tensor
    #: entities that may answer; shape: (M, E), bool
    candidates: Tensor
    #: made once where they fit into ``BUDGET``; else piece by piece, whenever they are queried
    rows: Rows | None


@dataclass(frozen=True)
class Terms:
    """What becomes of queries, one by one; shapes: (M, Q)."""

    #: 1 / (|R_G - R_P| + 1)
    closeness: Tensor
    #: the plain rank
    rank: Tensor
    #: rivals tied with the answer in R_P
    tied: Tensor


@dataclass(frozen=True)
class Answered:
    """Rows of queries, and what becomes of each."""

    rows: Rows
    #: of the head queries, then the tail queries; 2Q terms
    entity: Terms
    relations: Terms


@dataclass(frozen=True)
class Result:
    """Measures of a stack; NaN where a model has no queries."""

    #: in the order of ``MEASURES``; shape: (M, 4), float64
    measures: Tensor
    #: triples queried about; shape: (M,)
    queries: Tensor
    #: rivals tied with the answer in R_P; shape: (M,)
    ties: Tensor


def padded_ids(queried: Tensor) -> Tensor:
    """Triple ids of a mask of shape (M, T), padded with -1 to the longest row; shape (M, Q)."""
    longest = max(1, int(queried.sum(1).max()))
    order = torch.sort((~queried).to(torch.int8), dim=1, stable=True).indices[:, :longest]
    return torch.where(queried.gather(1, order), order, -1)


def prepare(session: Session, slots: Tensor, queried: Tensor, filtered: Tensor, candidates: Tensor) -> Queries:
    """Queries of a scope, with their rows where these fit into ``BUDGET`` (see ``Queries``)."""
    queries = Queries(session, slots, queried, filtered, candidates, None)
    return replace(queries, rows=_rows(queries, slots)) if len(_pieces(queries)) == 1 else queries


def _pieces(queries: Queries) -> tuple[Tensor, ...]:
    """The slots in pieces whose score matrices, (M, 2Q, E), fit into ``BUDGET``."""
    models, entities = queries.candidates.shape
    return torch.split(queries.slots, max(1, BUDGET // (2 * models * entities)), 1)


def _rows(queries: Queries, slots: Tensor) -> Rows:
    graph, session = queries.session.graph, queries.session
    triple = slots.clamp(min=0)
    head, relation, tail = graph.triples[triple].unbind(-1)
    heads, tails = (_rivals(queries, triple, slot, queries.candidates) for slot in (HEAD, TAIL))
    every_relation = torch.ones(len(slots), len(graph.relations), dtype=torch.bool)
    counted = (slots >= 0) & queries.queried.gather(1, triple)
    shares = _relation_shares(session, queries.queried).gather(1, relation) * counted
    number = queries.queried.sum(1, keepdim=True).clamp(min=1)
    return Rows(
        head, relation, tail, _stacked(heads, tails), _rivals(queries, triple, RELATION, every_relation),
        torch.cat([shares, shares], 1) / 2, counted / number,
    )  # fmt: skip


def _rivals(queries: Queries, triple: Tensor, slot: int, candidates: Tensor) -> Competitors:
    """Rivals of the queries that hide one slot of triples, (M, Q)."""
    graph = queries.session.graph
    known = graph.same_but(slot, triple)  # (M, Q, X)
    ids = known.clamp(min=0)
    listed = graph.triples[:, slot][ids]
    models = torch.arange(len(triple))[:, None, None]
    may_answer = candidates[models, listed] & (known >= 0)
    is_answer, counts, own = ids == triple[..., None], graph.counts[ids], graph.counts[triple][..., None]
    barred = queries.filtered[models, ids] | is_answer
    higher = (may_answer & ~barred & (counts > own)).sum(-1)
    equal = may_answer & (barred | (counts == own))
    return Competitors(candidates.float(), listed, (may_answer & barred).float(), equal.float(), 1 + higher)


def _stacked(heads: Competitors, tails: Competitors) -> Competitors:
    """Head queries, then tail queries, padded to the same number of listed answers."""
    longest = max(heads.listed.shape[-1], tails.listed.shape[-1])

    def both(name: str) -> Tensor:
        parts = (getattr(rivals, name) for rivals in (heads, tails))
        return torch.cat([torch.nn.functional.pad(part, (0, longest - part.shape[-1])) for part in parts], 1)

    rank = torch.cat([heads.true_rank, tails.true_rank], 1)
    return Competitors(heads.candidates, both("listed"), both("barred"), both("equal"), rank)


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
    """By candidate: 1 where it scores above the answer, ½ where they are tied, else 0.

    Args:
        scores: shape (M, Q, C).
        answer: index of the answer in its row; shape (M, Q).
    """
    ahead = scores - scores.gather(-1, answer[..., None])
    tie = TIE * scores.abs().amax(-1, keepdim=True)
    return ((ahead > tie).float() + ~(ahead < -tie)) / 2  # NaN is tied with everything: a diverged model is at chance


def evaluate(embedding: Embedding, scopes: Mapping[str, Queries]) -> dict[str, Result]:
    """Measures in scopes whose queries share their rows (``Queries.slots`` are the same)."""
    sums: dict[str, list[tuple[Tensor, Tensor]]] = {name: [] for name in scopes}
    for piece in answers(embedding, scopes):
        for name, answered in piece.items():
            sums[name].append(_measure(answered))
    return {name: _result(scopes[name], parts) for name, parts in sums.items()}


def answers(embedding: Embedding, scopes: Mapping[K, Queries]) -> Iterator[dict[K, Answered]]:
    """What becomes of each query, in as many pieces as the queries have (see ``evaluate``)."""
    first = next(iter(scopes.values()))
    for piece in _pieces(first):
        rows = {name: queries.rows or _rows(queries, piece) for name, queries in scopes.items()}
        one = next(iter(rows.values()))
        heads = embedding.score_heads(one.relation, one.tail)
        tails = embedding.score_tails(one.head, one.relation)
        entity = compare(torch.cat([heads, tails], 1), torch.cat([one.head, one.tail], 1))
        relations = compare(embedding.score_relations(one.head, one.tail), one.relation)
        yield {
            name: Answered(own, _terms(entity, own.entity), _terms(relations, own.relations))
            for name, own in rows.items()
        }


def _terms(ahead: Tensor, rivals: Competitors) -> Terms:
    """Terms of queries by who is ahead of the answer (see ``compare``)."""
    of_listed = ahead.gather(-1, rivals.listed)
    total = _over_candidates(ahead, rivals)
    predicted_rank = 1 + total - (of_listed * rivals.equal).sum(-1)
    rank = 1 + total - (of_listed * rivals.barred).sum(-1)
    tied = _over_candidates((ahead == 0.5).float(), rivals) - ((of_listed == 0.5) * rivals.equal).sum(-1)
    return Terms(closeness(rivals.true_rank, predicted_rank), rank, tied)


def _measure(answered: Answered) -> tuple[Tensor, Tensor]:
    """Share of some rows in the measures, (M, 4), and their ties, (M,)."""
    star, plain, rows = [], [], answered.rows
    ties = torch.zeros(len(rows.head))
    for terms, weight in ((answered.entity, rows.entity_weight), (answered.relations, rows.relation_weight)):
        star.append(bits.ordered_sum(weight * terms.closeness))
        plain.append(bits.ordered_sum(weight / terms.rank))
        ties += (terms.tied * (weight > 0)).sum(1)
    return torch.stack([sum(star) / 2, *star, sum(plain) / 2], 1), ties  # type: ignore[list-item]


def _over_candidates(values: Tensor, rivals: Competitors) -> Tensor:
    """Sum of values, (M, Q, C), over those who may answer; exact, since they are halves; (M, Q)."""
    return (values @ rivals.candidates[..., None])[..., 0]


def _result(queries: Queries, parts: list[tuple[Tensor, Tensor]]) -> Result:
    measures, ties = (torch.stack(values).sum(0) for values in zip(*parts, strict=True))
    number = queries.queried.sum(1)
    return Result(measures.masked_fill((number == 0)[:, None], torch.nan), number, ties.long())


def closeness(true_rank: Tensor, predicted_rank: Tensor) -> Tensor:
    """The term of MRR*: 1 / (|R_G - R_P| + 1) (equation 7)."""
    return 1 / ((true_rank - predicted_rank).abs() + 1)
