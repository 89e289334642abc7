"""Baselines beyond the paper: means weighted by similarity, and ERAvg."""

from dataclasses import replace

import torch
from torch import Tensor

from isi.config import NotNegative, Positive
from isi.initializers import similarity
from isi.initializers.api import NONE, InitResult, initializer
from isi.initializers.context import InitContext

_WEIGHTS = [4.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0]
_TEMPERATURES = [0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2]


@initializer(
    "soft_es",
    label="Soft ES",
    role="baseline",
    needs=("words",),
    defaults={"temperature": 0.07},
    grid={"temperature": _TEMPERATURES},
    calibration=[{"temperature": 0.13}],
)
def soft_entity_similarity(context: InitContext, temperature: Positive) -> InitResult:
    """Soft ES (ConSE): the mean of all known entities,
    weighted by softmax(cos / temperature) of their names.
    """
    return similarity.mean_of_first(
        context,
        words=lambda: softmax(
            similarity.word_similarity(context) / temperature, similarity.word_eligible(context)
        ),
        triples=lambda: _soft_by_relations(context, temperature),
    )


@initializer(
    "soft_rs",
    label="Soft RS",
    role="baseline",
    needs=("insert_triples", "inverse"),
    defaults={"temperature": 0.02},
    grid={"temperature": _TEMPERATURES},
)
def soft_relational_similarity(context: InitContext, temperature: Positive) -> InitResult:
    """Soft RS: the mean of all known entities,
    weighted by softmax(score / temperature) of RS's score.
    """
    return similarity.mean_of_first(
        context, triples=lambda: _soft_by_relations(context, temperature)
    )


@initializer(
    "soft_hybrid",
    label="Soft hybrid",
    role="baseline",
    needs=("words", "insert_triples", "inverse"),
    defaults={"word_weight": 12.0, "relation_weight": 32.0},
    grid={"word_weight": _WEIGHTS, "relation_weight": _WEIGHTS},
)
def soft_hybrid(
    context: InitContext, word_weight: NotNegative, relation_weight: NotNegative
) -> InitResult:
    """Soft hybrid: the mean of all known entities,
    weighted by a softmax of weighted word and relation similarities.
    """
    similar = word_weight * similarity.word_similarity(context)
    related = torch.zeros_like(similar)
    if context.theta0.model.invertible:  # MAP's prior does without
        related = relation_weight * similarity.mean_relational_score(context)
    named = similarity.word_eligible(context)
    return similarity.mean_of_first(
        context,
        both=lambda: softmax(similar + related, named),
        triples=lambda: softmax(related, context.candidates),
        words=lambda: softmax(similar, named),
    )


def softmax(score: Tensor, eligible: Tensor) -> Tensor:
    """Softmax of scores, (M, n, E), over the eligible entities; zero if none is eligible; float64,
    since exponentials in float32 differ between processors.
    """
    return torch.softmax(score.double().masked_fill(~eligible, -torch.inf), -1).nan_to_num(0)


def _soft_by_relations(context: InitContext, temperature: float) -> Tensor:
    return softmax(similarity.mean_relational_score(context) / temperature, context.candidates)


@initializer(
    "er_avg",
    label="ERAvg",
    role="baseline",
    needs=("insert_triples", "inverse"),
    grid={},
)
def entity_relation_average(context: InitContext) -> InitResult:
    """ERAvg (Albooyeh et al. 2020): the mean of the insert triples' known ends,
    each taken through its relation.
    """
    observed, to_head = context.observed[..., None], context.theta0.model.transform_tail
    mapped = (similarity.insert_triple_ends(context, to_head) * observed).sum(2) / observed.sum(
        2
    ).clamp(min=1)
    return _or_centroid(context, mapped, triples=lambda: similarity.all_known(context))


def _or_centroid(context: InitContext, vectors: Tensor, **ways: similarity.Weigh) -> InitResult:
    """Vectors, (M, n, d), of novel entities with the data that ``ways`` need;
    for others the known centroid.
    """
    fallback = similarity.weights_or_fallback(context, **ways)[1]
    centre = similarity.centroid(context, similarity.all_known(context), fallback)
    vectors = torch.where(
        (centre.fallback == NONE)[..., None], vectors.to(centre.vectors.dtype), centre.vectors
    )
    return replace(centre, vectors=vectors, weights=None, is_centroid=False)
