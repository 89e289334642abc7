"""Baselines beyond the paper: means weighted by similarity, ERAvg, neighbours, noise,
a linear map from words.
"""

from dataclasses import replace

import torch
from torch import Tensor
from torch.linalg import solve
from torch.nn.functional import normalize

from isi.config import NotNegative, Positive
from isi.initializers import similarity
from isi.initializers.api import NONE, InitContext, InitResult, initializer
from isi.initializers.paper import standard_normal

_WEIGHTS = [4.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0]
_TEMPERATURES = [0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2]


@initializer(
    "soft_es",
    label="Soft ES",
    role="baseline",
    colour="#56a3d9",
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
    colour="#4cc2a0",
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
    colour="#b8488f",
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
    "class_noise",
    label="Kind mean + noise",
    role="baseline",
    colour="#a6761d",
    defaults={"fraction": 0.1},
    grid={"fraction": [0.1, 0.25, 0.5, 1.0]},
)
def class_noise(context: InitContext, fraction: NotNegative) -> InitResult:
    """Kind mean + noise: the mean + fraction · σ · N(0, 1),
    σ the deviation within the kind (arXiv 2511.11118).
    """
    kind, fallback = similarity.weights_or_fallback(
        context, nothing=lambda: similarity.same_kind(context)
    )
    noise = fraction * deviation(context, kind) * standard_normal(context)
    return InitResult(similarity.centroid(context, kind, fallback).vectors + noise, fallback)


def deviation(context: InitContext, among: Tensor) -> Tensor:
    """Standard deviation of each coordinate over the entities of a mask, (M, n, E);
    shape (M, n, d).
    """
    weight, entity = among.double(), context.theta0.entity.double()
    weight /= weight.sum(-1, keepdim=True)
    return (weight @ entity.square() - (weight @ entity).square()).clamp(min=0).sqrt().float()


@initializer(
    "er_avg",
    label="ERAvg",
    role="baseline",
    colour="#9467bd",
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


@initializer(
    "neighbour_mean",
    label="Neighbour mean",
    role="baseline",
    colour="#c9a227",
    needs=("insert_triples",),
    grid={},
)
def neighbour_mean(context: InitContext) -> InitResult:
    """Neighbour mean: the mean of the known ends of the insert triples,
    each as often as it occurs.
    """
    number = torch.zeros(*context.novel.shape, context.known.shape[1])
    number.scatter_add_(-1, context.other, context.observed.float())
    return similarity.mean_of_first(context, triples=lambda: number)


@initializer(
    "projection",
    label="Projection",
    role="baseline",
    colour="#e377c2",
    needs=("words",),
    defaults={"penalty": 0.3},
    grid={"penalty": [0.03, 0.1, 0.3, 1.0, 3.0, 10.0]},
)
def projection(context: InitContext, penalty: Positive) -> InitResult:
    """Projection: a linear map from word vectors to entities' vectors,
    by ridge regression on the known (DeViSE).
    """
    return _or_centroid(
        context,
        predicted(context, penalty),
        words=lambda: similarity.word_eligible(context).any(-1, keepdim=True),
    )


def predicted(context: InitContext, penalty: float) -> Tensor:
    """ȳ + Bᵀ(x - x̄), B = argmin Σ ‖y - ȳ - Bᵀ(x - x̄)‖² + penalty ‖B‖²; x: unit word vector, y:
    vector; (M, n, d).
    """
    named = context.eligible & context.worded
    weight = named[..., None].double()
    words, entity = normalize(context.words.double(), dim=-1), context.theta0.entity.double()
    number = weight.sum(1, keepdim=True).clamp(min=1)
    from_words, to_entity = (
        (weight * table).sum(1, keepdim=True) / number for table in (words, entity)
    )
    inputs, outputs = weight * (words - from_words), weight * (entity - to_entity)
    slopes: Tensor = solve(
        inputs.mT @ inputs + penalty * torch.eye(words.shape[-1]), inputs.mT @ outputs
    )
    return to_entity + (words[context.novel] - from_words) @ slopes


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
