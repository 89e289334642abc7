"""Interference of new entities: how often they rank above the known answers of queries, and what that does to ranks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi.errors import InputError
from isi.evaluation.ranking import compare, make_queries, padded_ids, rank_queries
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.sessions import TRAIN, Session
from isi.insertion.arguments import graph_of
from isi.models.stack import Embedding, rows
from isi.random import stream


@dataclass(frozen=True)
class Interference:
    """What new entities do to known answers. A triple is two queries: for its head, and for its tail."""

    queries: int
    #: of each new entity, the share of queries in which it ranks above the known answer (½ where they are tied);
    #: where an insert triple makes it an answer itself, it does not count
    above: list[float]
    #: filtered mean reciprocal rank and mean rank of the known answers, among known entities and among all
    mrr_before: float
    mrr_after: float
    rank_before: float
    rank_after: float


def interference(
    embedding: Embedding, known: int, queried: np.ndarray, insert_triples: np.ndarray, known_triples: np.ndarray,
    most: int, seed: int,
) -> Interference:  # fmt: skip
    """How new entities, from id ``known`` on, rank among the answers of triples of known ones.

    Args:
        queried: ids, shape (Q, 3); as many as ``most`` of them are drawn.
        insert_triples: right as answers, too.
        known_triples: right as answers, and filtered.

    Raises:
        InputError: where there is nothing to query.
    """
    if not len(queried) or (queried[:, [HEAD, TAIL]] >= known).any():
        raise InputError("argument 'triples'", "", "expected triples of known entities, to ask about")
    if len(queried) > most:
        queried = queried[np.sort(stream(seed, "interference").permutation(len(queried))[:most])]
    before, after = _ranks(embedding, queried, np.concatenate([queried, insert_triples, known_triples]), known)
    above = ranked_above(embedding, known, torch.from_numpy(queried), torch.from_numpy(insert_triples))
    return Interference(
        2 * len(queried), above.tolist(),
        (1 / before).mean().item(), (1 / after).mean().item(), before.mean().item(), after.mean().item(),
    )  # fmt: skip


def ranked_above(embedding: Embedding, known: int, queried: Tensor, insert_triples: Tensor) -> Tensor:
    """Share of queries in which each new entity ranks above the answer; shapes (Q, 3), (I, 3), result (n,)."""
    head, relation, tail = queried.T[:, None]  # (1, Q)
    relations, new = rows(embedding.relation, relation), embedding.entity[:, known:]
    model, heads, tails = embedding.model, rows(embedding.entity, head), rows(embedding.entity, tail)
    answer = model.score(heads, relations, tails)[..., None]
    total = torch.zeros(new.shape[1], dtype=torch.float64)
    for scores, end, slot in (
        (model.score_tails(heads, relations, new), HEAD, TAIL), (model.score_heads(tails, relations, new), TAIL, HEAD)
    ):  # fmt: skip
        above = compare(torch.cat([answer, scores], -1), torch.zeros_like(head))[0, :, 1:]
        total += above.masked_fill(_right(queried, insert_triples, known, end, slot, len(total)), 0).double().sum(0)
    return total / (2 * len(queried))


def _right(queried: Tensor, insert_triples: Tensor, known: int, end: int, slot: int, number: int) -> Tensor:
    """Which new entities an insert triple puts into the slot of a query; shape (Q, n), bool."""
    in_slot = insert_triples[insert_triples[:, slot] >= known]
    same_end = queried[:, None, end] == in_slot[:, end]
    query, triple = (same_end & (queried[:, None, RELATION] == in_slot[:, RELATION])).nonzero(as_tuple=True)
    right = torch.zeros(len(queried), number, dtype=torch.bool)
    right[query, in_slot[triple, slot] - known] = True
    return right


def _ranks(embedding: Embedding, queried: np.ndarray, right: np.ndarray, known: int) -> tuple[Tensor, Tensor]:
    """Filtered ranks of the answers among known entities and among all; shapes (2Q,).

    Args:
        right: triples, of which the queried ones come first; shape (T, 3).
    """
    triples, place = np.unique(right, axis=0, return_inverse=True)
    graph, number, entities = graph_of(triples, embedding), len(triples), embedding.entity.shape[1]
    everyone = torch.ones(1, entities, dtype=torch.bool)
    session = Session(graph, everyone, torch.full((1, number), TRAIN, dtype=torch.int8))
    is_queried = torch.zeros(1, number, dtype=torch.bool)
    is_queried[:, torch.from_numpy(place.flatten()[: len(queried)])] = True
    slots, filtered = padded_ids(is_queried), torch.ones_like(is_queried)
    queries = {
        name: make_queries(session, slots, is_queried, filtered, candidates)
        for name, candidates in (("before", torch.arange(entities)[None] < known), ("after", everyone))
    }
    pieces = list(rank_queries(embedding, queries))
    before, after = (torch.cat([piece[name].entity.rank[0] for piece in pieces]).double() for name in queries)
    return before, after
