"""Interference: how often new entities rank above what answered before them."""

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
    #: where it is told to be an answer itself, it does not count
    above: list[float]
    #: filtered mean reciprocal rank and mean rank of the known answers, among known entities and among all
    mrr_before: float
    mrr_after: float
    rank_before: float
    rank_after: float


def interference(
    embedding: Embedding, known: int, asked: np.ndarray, told: np.ndarray, known_triples: np.ndarray, most: int,
    seed: int,
) -> Interference:  # fmt: skip
    """How new entities, from id ``known`` on, rank among the answers of triples of known ones.

    Args:
        asked: ids, shape (Q, 3); as many as ``most`` of them are drawn.
        told: triples of new entities, which are right as answers.
        known_triples: which are no rivals.

    Raises:
        InputError: where there is nothing to ask.
    """
    if not len(asked) or (asked[:, [HEAD, TAIL]] >= known).any():
        raise InputError("argument 'triples'", "", "expected triples of known entities, to ask about")
    if len(asked) > most:
        asked = asked[np.sort(stream(seed, "interference").permutation(len(asked))[:most])]
    before, after = _ranks(embedding, asked, np.concatenate([asked, told, known_triples]), known)
    return Interference(
        2 * len(asked), ranked_above(embedding, known, torch.from_numpy(asked), torch.from_numpy(told)).tolist(),
        (1 / before).mean().item(), (1 / after).mean().item(), before.mean().item(), after.mean().item(),
    )  # fmt: skip


def ranked_above(embedding: Embedding, known: int, asked: Tensor, told: Tensor) -> Tensor:
    """Share of queries in which each new entity ranks above the answer; shapes (Q, 3), (I, 3), result (n,)."""
    head, relation, tail = asked.T[:, None]  # (1, Q)
    of, new = rows(embedding.relation, relation), embedding.entity[:, known:]
    family, heads, tails = embedding.model, rows(embedding.entity, head), rows(embedding.entity, tail)
    answer = family.score(heads, of, tails)[..., None]
    total = torch.zeros(new.shape[1], dtype=torch.float64)
    for scores, given, slot in (
        (family.score_tails(heads, of, new), HEAD, TAIL), (family.score_heads(tails, of, new), TAIL, HEAD)
    ):  # fmt: skip
        ahead = compare(torch.cat([answer, scores], -1), torch.zeros_like(head))[0, :, 1:]
        total += ahead.masked_fill(_right(asked, told, known, given, slot, len(total)), 0).double().sum(0)
    return total / (2 * len(asked))


def _right(asked: Tensor, told: Tensor, known: int, given: int, slot: int, number: int) -> Tensor:
    """Which new entities are told to be in a slot of a query; shape (Q, n), bool."""
    own = told[told[:, slot] >= known]
    same = (asked[:, None, given] == own[:, given]) & (asked[:, None, RELATION] == own[:, RELATION])
    query, triple = same.nonzero(as_tuple=True)
    found = torch.zeros(len(asked), number, dtype=torch.bool)
    found[query, own[triple, slot] - known] = True
    return found


def _ranks(embedding: Embedding, asked: np.ndarray, right: np.ndarray, known: int) -> tuple[Tensor, Tensor]:
    """Ranks of the answers among known entities and among all, less those of right triples; shapes (2Q,).

    Args:
        right: triples, of which those that are asked come first; shape (T, 3).
    """
    triples, place = np.unique(right, axis=0, return_inverse=True)
    graph, number, entities = graph_of(triples, embedding), len(triples), embedding.entity.shape[1]
    everyone = torch.ones(1, entities, dtype=torch.bool)
    session = Session(graph, everyone, torch.full((1, number), TRAIN, dtype=torch.int8))
    is_asked = torch.zeros(1, number, dtype=torch.bool)
    is_asked[:, torch.from_numpy(place.flatten()[: len(asked)])] = True
    among = {"before": torch.arange(entities)[None] < known, "after": everyone}
    slots, filtered = padded_ids(is_asked), torch.ones_like(is_asked)
    queries = {name: make_queries(session, slots, is_asked, filtered, some) for name, some in among.items()}
    pieces = list(rank_queries(embedding, queries))
    before, after = (torch.cat([piece[name].entity.rank[0] for piece in pieces]).double() for name in among)
    return before, after
