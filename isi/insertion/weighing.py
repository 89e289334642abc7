"""Weighted means of known vectors: what initializers share that weigh all entities instead of choosing a few."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.insertion.core import ES, NONE, RS, Initial, Insertion
from isi.insertion.similarity import (
    first_able,
    has_insert_triples,
    has_words,
    relational_score,
    word_eligible,
    word_similarity,
)


def first_weighted(insertion: Insertion, *ways: tuple[int, Tensor, Tensor]) -> Initial:
    """The mean by the weights of the first way that can serve a novel entity (see ``first_able``)."""
    weights, fallback = first_able(insertion, *ways)
    weights = weights.to(insertion.theta0.entity.dtype)
    return Initial((weights / weights.sum(-1, keepdim=True)) @ insertion.theta0.entity, fallback)


def soft(score: Tensor, eligible: Tensor) -> Tensor:
    """Softmax of scores, (M, n, E), over the eligible entities; zero where there is none."""
    return torch.softmax(score.masked_fill(~eligible, -torch.inf), -1).nan_to_num(0)


def mean_relational_score(insertion: Insertion) -> Tensor:
    """``relational_score`` over the number of relations of the insert triples: a mean cosine; shape (M, n, E)."""
    seen = torch.zeros(*insertion.novel.shape, insertion.theta0.relation.shape[1])
    seen.scatter_add_(-1, insertion.relation, insertion.observed.float())
    return relational_score(insertion) / (seen > 0).sum(-1, keepdim=True).clamp(min=1)


def softly_by_both(insertion: Insertion, word_weight: float, relation_weight: float) -> Initial:
    """Mean by the softmax of ``word_weight`` · cosine of words + ``relation_weight`` · mean relational score.

    A novel entity that lacks words or insert triples has the softmax of the other part alone.
    """
    words, triples = has_words(insertion), has_insert_triples(insertion)
    similar, related = word_weight * word_similarity(insertion), relation_weight * mean_relational_score(insertion)
    named = word_eligible(insertion)
    return first_weighted(
        insertion,
        (NONE, words & triples, soft(similar + related, named)),
        (RS, triples, soft(related, insertion.eligible[:, None])),
        (ES, words, soft(similar, named)),
    )
