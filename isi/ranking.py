"""Filtered ranks and MRR* (equation 7), in the scopes that tell old knowledge from new.

A query hides one slot of a triple. Its candidates are the entities of the session (or the
relations), except those that make a triple of the filter; the true answer always stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.embeddings import analogy
from isi.embeddings.stack import Embedding
from isi.sessions import TEST, TRAIN, VALID, Session, as_table, membership, touches

#: Scores closer to the answer's than this times the largest magnitude in their row are tied.
TIE = 1e-5
MEASURES = ("mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr")


@dataclass(frozen=True)
class Rivals:
    """Who competes with the answer of each query, and the answer's true rank."""

    #: candidates other than the answer, for the plain rank; shape: (M, Q, C), float32 of 0 and 1
    candidates: Tensor
    #: of these, the ones whose count differs from the answer's, for R_P; shape: (M, Q, C)
    unequal: Tensor
    #: R_G; shape: (M, Q)
    true_rank: Tensor


@dataclass(frozen=True)
class Queries:
    """The queries of a stack of sessions in one scope; models with fewer have rows of weight zero."""

    #: ids of head, relation and tail; shapes: (M, Q)
    head: Tensor
    relation: Tensor
    tail: Tensor
    #: the head queries (?, r, t), then the tail queries (h, r, ?): (M, 2Q, E)
    entity: Rivals
    #: the relation queries (h, ?, t): (M, Q, R)
    relations: Rivals
    #: shares of the entity queries in ``mrr_star_entity``, sums to 1 where there are any; shape: (M, 2Q)
    entity_weight: Tensor
    #: shares of the relation queries; shape: (M, Q)
    relation_weight: Tensor
    #: number of triples asked about; shape: (M,)
    count: Tensor


@dataclass(frozen=True)
class Scores:
    """Scores of all answers to the queries of a stack."""

    #: head queries, then tail queries; shape: (M, 2Q, E)
    entity: Tensor
    #: shape: (M, Q, R)
    relations: Tensor


@dataclass(frozen=True)
class Result:
    """Measures of a stack; NaN where a model has no queries."""

    #: in the order of ``MEASURES``; shape: (M, 4), float64
    measures: Tensor
    #: triples asked about; shape: (M,)
    queries: Tensor
    #: rivals tied with the answer in R_P; shape: (M,)
    ties: Tensor


def query_slots(asked: Tensor) -> Tensor:
    """Triple ids of a mask of shape (M, T), padded with -1 to the longest row; shape (M, Q)."""
    longest = max(1, int(asked.sum(1).max()))
    order = torch.sort((~asked).to(torch.int8), dim=1, stable=True).indices[:, :longest]
    return torch.where(asked.gather(1, order), order, -1)


def prepare(session: Session, slots: Tensor, asked: Tensor, filtered: Tensor, candidates: Tensor) -> Queries:
    """Everything about the queries that does not depend on the scores.

    Args:
        session: gives the graph, the ground truth and the weights of the relations.
        slots: ids of the triples that have a row, -1 for padding; shape (M, Q).
        asked: triples that are asked about in this scope; shape (M, T), bool.
        filtered: triples that are left out as rivals; shape (M, T), bool.
        candidates: entities that may answer; shape (M, E), bool.
    """
    graph = session.graph
    triples = graph.triples[slots.clamp(min=0)]
    head, relation, tail = triples.unbind(-1)
    models = torch.arange(len(slots))[:, None]
    truth, barred = graph.ground_truth, as_table(graph, filtered)
    counts = torch.cat([truth[relation, :, tail], truth[relation, head]], 1)
    free = ~torch.cat([barred[models, relation, :, tail], barred[models, relation, head]], 1)
    entity = _rivals(counts, free & candidates[:, None], torch.cat([head, tail], 1))
    relations = _rivals(truth[:, head, tail].movedim(0, -1), ~barred[models, :, head, tail], relation)
    counted = (slots >= 0) & asked.gather(1, slots.clamp(min=0))
    weight = _relation_shares(session, relation, counted)
    number = counted.sum(1)
    return Queries(head, relation, tail, entity, relations, torch.cat([weight, weight], 1) / 2,
                   counted / number.clamp(min=1)[:, None], number)  # fmt: skip


def _rivals(counts: Tensor, free: Tensor, answer: Tensor) -> Rivals:
    """From counts and free candidates, (M, Q, C), and the answers, (M, Q)."""
    own = counts.gather(-1, answer[..., None])
    others = free.scatter(-1, answer[..., None], False)
    return Rivals(others.float(), (others & (counts != own)).float(), 1 + (others & (counts > own)).sum(-1))


def _relation_shares(session: Session, relation: Tensor, counted: Tensor) -> Tensor:
    """Weight of each query: its relation's share of observations, dealt out to its queries; (M, Q)."""
    graph = session.graph
    of = torch.nn.functional.one_hot(relation, len(graph.relations)) * counted[..., None]  # (M, Q, R)
    queries = of.sum(1)
    in_session = (session.splits >= 0) * graph.counts
    observed = torch.zeros(len(counted), len(graph.relations), dtype=torch.int64)
    observed.index_add_(1, graph.triples[:, 1], in_session)
    observed = observed * (queries > 0)
    share = observed / observed.sum(1, keepdim=True).clamp(min=1)
    return (of * (share / queries.clamp(min=1))[:, None]).sum(-1)


def score(embedding: Embedding, queries: Queries) -> Scores:
    """Scores of every answer to the queries; the answer's own is read from the same rows."""
    heads = analogy.score_heads(embedding, queries.relation, queries.tail)
    tails = analogy.score_tails(embedding, queries.head, queries.relation)
    return Scores(torch.cat([heads, tails], 1), analogy.score_relations(embedding, queries.head, queries.tail))


def compare(scores: Tensor, answer: Tensor) -> Tensor:
    """By candidate: 1 where it scores above the answer, ½ where they are tied, else 0.

    Args:
        scores: shape (M, Q, C).
        answer: index of the answer in its row; shape (M, Q).
    """
    ahead = scores - scores.gather(-1, answer[..., None])
    tie = TIE * scores.abs().amax(-1, keepdim=True)
    return ((ahead > tie).float() + (ahead >= -tie)) / 2


def evaluate(embedding: Embedding, scopes: dict[str, Queries]) -> dict[str, Result]:
    """Measures in scopes whose queries share their rows (``Queries.head`` and so on are the same)."""
    first = next(iter(scopes.values()))
    scores = score(embedding, first)
    entity = compare(scores.entity, torch.cat([first.head, first.tail], 1))
    relations = compare(scores.relations, first.relation)
    return {name: _measure(entity, relations, queries) for name, queries in scopes.items()}


def _measure(entity: Tensor, relations: Tensor, queries: Queries) -> Result:
    star, plain = [], []
    ties = torch.zeros(len(entity))
    asked = ((entity, queries.entity, queries.entity_weight),
             (relations, queries.relations, queries.relation_weight))  # fmt: skip
    for ahead, rivals, weight in asked:
        star.append(_total(weight * closeness(rivals.true_rank, _rank(ahead, rivals.unequal))))
        plain.append(_total(weight / _rank(ahead, rivals.candidates)))
        ties += (((ahead == 0.5) * rivals.unequal).sum(-1) * (weight > 0)).sum(1)
    measures = torch.stack([sum(star) / 2, *star, sum(plain) / 2], 1)  # type: ignore[list-item]
    measures[queries.count == 0] = torch.nan
    return Result(measures, queries.count, ties.long())


def _total(terms: Tensor) -> Tensor:
    """Sum over queries, one after the other, so that padding changes no bit; shape (M,), float64."""
    return terms.double().cumsum(1)[:, -1]


def _rank(ahead: Tensor, rivals: Tensor) -> Tensor:
    """1 + the rivals ahead of the answer, tied ones counting half; shape (M, Q)."""
    return 1 + (ahead * rivals).sum(-1)


def closeness(true_rank: Tensor, predicted_rank: Tensor) -> Tensor:
    """The term of MRR*: 1 / (|R_G - R_P| + 1) (equation 7)."""
    return 1 / ((true_rank - predicted_rank).abs() + 1)


def validation(session: Session) -> dict[str, Queries]:
    """The validation triples, with train and valid as filter: what early stopping looks at."""
    asked = session.members(VALID)
    queries = prepare(session, query_slots(asked), asked, session.members(TRAIN, VALID), session.entities)
    return {"valid": queries}


def epoch_scopes(session: Session, novel: Tensor) -> dict[str, Queries]:
    """Scopes of D¹ that are followed through training: all, known, known_closed, novel_heldout.

    Args:
        session: D¹.
        novel: the novel entities of each model; shape (M, n).
    """
    is_novel = membership(novel, session.entities.shape[1])
    new = touches(session.graph, is_novel)
    test, heldout = session.members(TEST), session.members(VALID, TEST) & new
    slots = query_slots(test | heldout)
    old, learned, everyone = test & ~new, session.members(TRAIN, VALID), session.entities
    return {
        "all": prepare(session, slots, test, learned, everyone),
        "known": prepare(session, slots, old, learned, everyone),
        "known_closed": prepare(session, slots, old, learned, everyone & ~is_novel),
        "novel_heldout": prepare(session, slots, heldout, session.members(TRAIN), everyone),
    }


def novel_scope(session: Session, novel: Tensor, inserted: Tensor) -> dict[str, Queries]:
    """Scope novel, at insertion: what touches a novel entity, less its insert triples.

    Args:
        session: D¹.
        novel: shape (M, n).
        inserted: the insert triples; shape (M, T), bool.
    """
    asked, filtered = _at_insertion(session, novel, novel, inserted)
    return {"novel": prepare(session, query_slots(asked), asked, filtered, session.entities)}


def entity_scopes(session: Session, novel: Tensor, inserted: Tensor) -> list[Queries]:
    """The queries of scope novel that touch one novel entity: one stack for each place in ``novel``."""
    queries = []
    for place in range(novel.shape[1]):
        asked, filtered = _at_insertion(session, novel, novel[:, place : place + 1], inserted)
        queries.append(prepare(session, query_slots(asked), asked, filtered, session.entities))
    return queries


def _at_insertion(session: Session, novel: Tensor, of: Tensor, inserted: Tensor) -> tuple[Tensor, Tensor]:
    graph, entities = session.graph, session.entities.shape[1]
    new = touches(graph, membership(novel, entities))
    about = touches(graph, membership(of, entities))
    asked = session.members(TRAIN, VALID, TEST) & about & ~inserted
    return asked, (session.members(TRAIN, VALID) & ~new) | inserted
