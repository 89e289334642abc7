"""Baselines of the literature: means of neighbours, ERAvg, noise around the kind's mean, and a map from words."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor
from torch.linalg import solve
from torch.nn.functional import normalize

from isi.config import NotNegative, Positive
from isi.initializers.api import NONE, InitContext, InitResult, initializer
from isi.initializers.controls import standard_normal
from isi.initializers.map import cell_anchors, insert_triple_table
from isi.initializers.similarity import (
    centroid,
    centroid_of_first,
    everyone_known,
    has_insert_triples,
    has_words,
    mean_of_first,
    same_kind,
    weights_of_first,
    word_eligible,
)


@initializer(
    "class_noise", label="Kind mean + noise", role="baseline", colour="#a6761d", cost="entities",
    defaults={"fraction": 0.1}, grid={"fraction": [0.1, 0.25, 0.5, 1.0]},
    description="Kind mean and noise: a random place among the known entities of the same kind (arXiv 2511.11118).",
)  # fmt: skip
def class_noise(context: InitContext, fraction: NotNegative) -> InitResult:
    """Kind mean + fraction · σ · N(0, 1), with the kind's deviation σ of each coordinate (see ``kind_mean``)."""
    everyone = torch.ones_like(context.novel, dtype=torch.bool)
    kind, fallback = weights_of_first(context, (NONE, everyone, lambda: same_kind(context)))
    noise = fraction * deviation(context, kind) * standard_normal(context)
    return InitResult(centroid(context, kind, fallback).vectors + noise, fallback)


def deviation(context: InitContext, among: Tensor) -> Tensor:
    """Deviation of each coordinate among some entities, a mask of shape (M, n, E); shape (M, n, d)."""
    weight, entity = among.double(), context.theta0.entity.double()
    weight /= weight.sum(-1, keepdim=True)
    return (weight @ entity.square() - (weight @ entity).square()).clamp(min=0).sqrt().float()


@initializer(
    "er_avg", label="ERAvg", role="baseline", colour="#9467bd", needs=("insert_triples", "inverse"), grid={},
    description="ERAvg (Albooyeh et al. 2020): the mean of the known ends of the insert triples, each taken through "
    "its relation.",
)  # fmt: skip
def entity_relation_average(context: InitContext) -> InitResult:
    """Mean over the insert triples of where their known ends meet the novel one; the centroid where there are none."""
    weights, able = insert_triple_table(context).flatten(2), has_insert_triples(context)
    mean = weights @ cell_anchors(context.theta0) / weights.sum(-1, keepdim=True).clamp(min=1)
    return _where_able(context, able, mean)


@initializer(
    "neighbour_mean", label="Neighbour mean", role="baseline", colour="#c9a227", needs=("insert_triples",), grid={},
    description="Neighbour mean: the mean of the known ends of the insert triples.",
)  # fmt: skip
def neighbour_mean(context: InitContext) -> InitResult:
    """Mean of the known ends of the insert triples, each as often as they name it."""
    triples = has_insert_triples(context)
    return mean_of_first(context, (NONE, triples, lambda: insert_triple_table(context).sum((2, 3))))


@initializer(
    "projection", label="Projection", role="baseline", colour="#e377c2", cost="entities", needs=("words",),
    defaults={"penalty": 0.3}, grid={"penalty": [0.03, 0.1, 0.3, 1.0, 3.0, 10.0]},
    description="Projection: a linear map from word vectors to entities' vectors, learned on the known ones (DeViSE).",
)  # fmt: skip
def projection(context: InitContext, penalty: Positive) -> InitResult:
    """Ridge regression from word vectors of unit length; the centroid where there is none."""
    return _where_able(context, has_words(context) & word_eligible(context).any(-1), predicted(context, penalty))


def predicted(context: InitContext, penalty: float) -> Tensor:
    """ȳ + (x - x̄)ᵀB, where B makes Σ ‖y - ȳ - Bᵀ(x - x̄)‖² + ``penalty`` ‖B‖² least; shape (M, n, d), float64."""
    weight = word_eligible(context)[:, 0, :, None].double()
    words, entity = normalize(context.words.double(), dim=-1), context.theta0.entity.double()
    number = weight.sum(1, keepdim=True).clamp(min=1)
    from_words, to_entity = ((weight * table).sum(1, keepdim=True) / number for table in (words, entity))
    inputs, outputs = weight * (words - from_words), weight * (entity - to_entity)
    slopes: Tensor = solve(inputs.mT @ inputs + penalty * torch.eye(words.shape[-1]), inputs.mT @ outputs)
    return to_entity + (words[context.novel] - from_words) @ slopes


def _where_able(context: InitContext, able: Tensor, vectors: Tensor) -> InitResult:
    """Vectors, (M, n, d), of the novel entities that have them, (M, n); the centroid of the known for the others."""
    centre = centroid_of_first(context, (NONE, able, lambda: everyone_known(context)))
    vectors = torch.where(able[..., None], vectors.to(centre.vectors.dtype), centre.vectors)
    return replace(centre, vectors=vectors, weights=None, is_centroid=False)
