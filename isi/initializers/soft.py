"""Weighted means of known vectors: what initializers share that weigh all entities instead of choosing a few.

Soft ES: all known entities, weighed by how near their word vectors are.

Soft RS: all known entities, weighed by how near they are to where the insert triples put the novel one.

Soft hybrid: all known entities, weighed by words and by relations, each with its temperature.
"""

from __future__ import annotations

import torch
from torch import Tensor

from isi.config import NotNegative, Positive
from isi.initializers.api import ES, NONE, RS, InitContext, InitResult, initializer
from isi.initializers.similarity import (
    first_able,
    has_insert_triples,
    has_words,
    relational_score,
    word_eligible,
    word_similarity,
)


def first_weighted(insertion: InitContext, *ways: tuple[int, Tensor, Tensor]) -> InitResult:
    """The mean by the weights of the first way that can serve a novel entity (see ``first_able``)."""
    weights, fallback = first_able(insertion, *ways)
    weights = weights.to(insertion.theta0.entity.dtype)
    return InitResult((weights / weights.sum(-1, keepdim=True)) @ insertion.theta0.entity, fallback)


def soft(score: Tensor, eligible: Tensor) -> Tensor:
    """Softmax of scores, (M, n, E), over the eligible entities; zero where there is none."""
    return torch.softmax(score.masked_fill(~eligible, -torch.inf), -1).nan_to_num(0)


def mean_relational_score(insertion: InitContext) -> Tensor:
    """``relational_score`` over the number of relations of the insert triples: a mean cosine; shape (M, n, E)."""
    seen = torch.zeros(*insertion.novel.shape, insertion.theta0.relation.shape[1])
    seen.scatter_add_(-1, insertion.relation, insertion.observed.float())
    return relational_score(insertion) / (seen > 0).sum(-1, keepdim=True).clamp(min=1)


def softly_by_both(insertion: InitContext, word_weight: float, relation_weight: float) -> InitResult:
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


@initializer("soft_es", label="Soft ES", role="baseline", colour="#56a3d9")
def soft_entity_similarity(insertion: InitContext, temperature: Positive) -> InitResult:
    """Mean by softmax(cos / temperature) of word vectors (Nadaraya and Watson's estimate; ConSE); else soft RS."""
    return first_weighted(
        insertion,
        (NONE, has_words(insertion), soft(word_similarity(insertion) / temperature, word_eligible(insertion))),
        (RS, has_insert_triples(insertion),
         soft(mean_relational_score(insertion) / temperature, insertion.eligible[:, None])),
    )  # fmt: skip


@initializer("soft_rs", label="Soft RS", role="baseline", colour="#4cc2a0")
def soft_relational_similarity(insertion: InitContext, temperature: Positive) -> InitResult:
    """Mean by softmax(score / temperature), the score of equation 5 over the number of relations seen."""
    weights = soft(mean_relational_score(insertion) / temperature, insertion.eligible[:, None])
    return first_weighted(insertion, (NONE, has_insert_triples(insertion), weights))


@initializer("soft_hybrid", label="Soft hybrid", role="baseline", colour="#b8488f")
def soft_hybrid(insertion: InitContext, word_weight: NotNegative, relation_weight: NotNegative) -> InitResult:
    """Mean by the softmax of both similarities; a weight is the inverse of a temperature."""
    return softly_by_both(insertion, word_weight, relation_weight)
