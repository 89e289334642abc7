"""Soft initializers: means of all known vectors by a softmax of similarity, in place of a choice of k indicators."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.config import NotNegative, Positive
from isi.initializers.api import ES, NONE, RS, InitContext, InitResult, initializer
from isi.initializers.similarity import (
    has_insert_triples,
    has_words,
    mean_of_first,
    mean_relational_score,
    word_eligible,
    word_similarity,
)

_WEIGHTS = [4.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0]
_TEMPERATURES = [0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2]


@initializer(
    "soft_es", label="Soft ES", role="baseline", colour="#56a3d9", cost="entities", needs=("words",),
    defaults={"temperature": 0.07}, grid={"temperature": _TEMPERATURES},
    description="Soft ES: the mean of all known entities, weighted by the similarity of their names.",
)  # fmt: skip
def soft_entity_similarity(context: InitContext, temperature: Positive) -> InitResult:
    """Mean by softmax(cos / temperature) of word vectors (Nadaraya and Watson's estimate; ConSE); else soft RS."""
    return mean_of_first(
        context,
        (NONE, has_words(context), lambda: softmax(word_similarity(context) / temperature, word_eligible(context))),
        (RS, has_insert_triples(context), lambda: _soft_by_relations(context, temperature)),
    )


@initializer(
    "soft_rs", label="Soft RS", role="baseline", colour="#4cc2a0", cost="entities", needs=("insert_triples", "inverse"),
    defaults={"temperature": 0.02}, grid={"temperature": _TEMPERATURES},
    description="Soft RS: the mean of all known entities, weighted by how near they are to where the insert triples "
    "point.",
)  # fmt: skip
def soft_relational_similarity(context: InitContext, temperature: Positive) -> InitResult:
    """Mean by softmax(score / temperature), the score of equation 5 over the number of relations seen."""
    triples = has_insert_triples(context)
    return mean_of_first(context, (NONE, triples, lambda: _soft_by_relations(context, temperature)))


@initializer(
    "soft_hybrid", label="Soft hybrid", role="baseline", colour="#b8488f", cost="entities",
    needs=("words", "insert_triples", "inverse"), defaults={"word_weight": 12.0, "relation_weight": 32.0},
    grid={"word_weight": _WEIGHTS, "relation_weight": _WEIGHTS},
    description="Soft hybrid: the mean of all known entities, weighted by names and by relations, each with its "
    "temperature.",
)  # fmt: skip
def soft_hybrid(context: InitContext, word_weight: NotNegative, relation_weight: NotNegative) -> InitResult:
    """Mean by the softmax of ``word_weight`` · cosine of words + ``relation_weight`` · mean relational score.

    A weight is the inverse of a temperature. A novel entity that lacks words or insert triples has the softmax of the
    other part alone.
    """
    words, triples = has_words(context), has_insert_triples(context)
    similar, related = word_weight * word_similarity(context), relation_weight * mean_relational_score(context)
    named = word_eligible(context)
    return mean_of_first(
        context,
        (NONE, words & triples, lambda: softmax(similar + related, named)),
        (RS, triples, lambda: softmax(related, context.eligible[:, None])),
        (ES, words, lambda: softmax(similar, named)),
    )


def softmax(score: Tensor, eligible: Tensor) -> Tensor:
    """Softmax of scores, (M, n, E), over the eligible entities; zero where there is none."""
    return torch.softmax(score.masked_fill(~eligible, -torch.inf), -1).nan_to_num(0)


def _soft_by_relations(context: InitContext, temperature: float) -> Tensor:
    return softmax(mean_relational_score(context) / temperature, context.eligible[:, None])
