"""Kind mean and noise: somewhere among what is known of the same kind (arXiv 2511.11118).

ERAvg (Albooyeh et al. 2020): the centre of what the insert triples name, taken through their relations.

Neighbour mean: the centre of what the insert triples name.

Projection: a linear map from word vectors to vectors of entities, learned on what is known (DeViSE).

RS without dead coordinates: what a relation's map no longer tells anything of takes no part (a control).
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor
from torch.linalg import solve, vector_norm
from torch.nn.functional import normalize

from isi.config import Count, NotNegative, Positive
from isi.initializers.api import NONE, InitContext, InitResult, initializer
from isi.initializers.controls import standard_normal
from isi.initializers.map import cell_anchors, insert_triple_table
from isi.initializers.similarity import (
    at_centroid,
    everyone_known,
    first_able,
    first_that_can,
    has_insert_triples,
    has_words,
    relational_score,
    resultants,
    same_kind,
    top_k,
    word_eligible,
)
from isi.initializers.soft import first_weighted
from isi.models.stack import Embedding


@initializer("class_noise", label="Kind mean + noise", role="baseline", colour="#a6761d")
def class_noise(insertion: InitContext, fraction: NotNegative) -> InitResult:
    """Kind mean + fraction · σ · N(0, 1), with the kind's deviation σ of each coordinate (see ``kind_mean``)."""
    everyone = torch.ones_like(insertion.novel, dtype=torch.bool)
    kind, fallback = first_able(insertion, (NONE, everyone, same_kind(insertion)))
    noise = fraction * deviation(insertion, kind) * standard_normal(insertion)
    return InitResult(at_centroid(insertion, kind, fallback).vectors + noise, fallback)


def deviation(insertion: InitContext, among: Tensor) -> Tensor:
    """Deviation of each coordinate among some entities, a mask of shape (M, n, E); shape (M, n, d)."""
    weight, entity = among.double(), insertion.theta0.entity.double()
    weight /= weight.sum(-1, keepdim=True)
    return (weight @ entity.square() - (weight @ entity).square()).clamp(min=0).sqrt().float()


@initializer("er_avg", label="ERAvg", role="baseline", colour="#9467bd")
def entity_relation_average(insertion: InitContext) -> InitResult:
    """Mean over the insert triples of where their known ends meet the novel one; the centroid where there are none."""
    weights, able = insert_triple_table(insertion).flatten(2), has_insert_triples(insertion)
    mean = weights @ cell_anchors(insertion.theta0) / weights.sum(-1, keepdim=True).clamp(min=1)
    otherwise = first_that_can(insertion, (NONE, able, everyone_known(insertion)))
    return replace(otherwise, vectors=torch.where(able[..., None], mean, otherwise.vectors), indicators=None)


@initializer("neighbour_mean", label="Neighbour mean", role="baseline", colour="#c9a227")
def neighbour_mean(insertion: InitContext) -> InitResult:
    """Mean of the known ends of the insert triples, each as often as they name it."""
    return first_weighted(insertion, (NONE, has_insert_triples(insertion), insert_triple_table(insertion).sum((2, 3))))


@initializer("projection", label="Projection", role="baseline", colour="#e377c2")
def projection(insertion: InitContext, penalty: Positive) -> InitResult:
    """Ridge regression from word vectors of unit length; the centroid where there is none."""
    able = has_words(insertion) & word_eligible(insertion).any(-1)
    otherwise = first_that_can(insertion, (NONE, able, everyone_known(insertion)))
    vectors = predicted(insertion, penalty).to(otherwise.vectors.dtype)
    return replace(otherwise, vectors=torch.where(able[..., None], vectors, otherwise.vectors), indicators=None)


def predicted(insertion: InitContext, penalty: float) -> Tensor:
    """ȳ + (x - x̄)ᵀB, where B makes Σ ‖y - ȳ - Bᵀ(x - x̄)‖² + ``penalty`` ‖B‖² least; shape (M, n, d), float64."""
    weight = word_eligible(insertion)[:, 0, :, None].double()
    words, entity = normalize(insertion.words.double(), dim=-1), insertion.theta0.entity.double()
    number = weight.sum(1, keepdim=True).clamp(min=1)
    from_words, to_entity = ((weight * table).sum(1, keepdim=True) / number for table in (words, entity))
    inputs, outputs = weight * (words - from_words), weight * (entity - to_entity)
    slopes: Tensor = solve(inputs.mT @ inputs + penalty * torch.eye(words.shape[-1]), inputs.mT @ outputs)
    return to_entity + (words[insertion.novel] - from_words) @ slopes


#: A map that stretches a coordinate by less is dead there: from here on down ``inverse`` would blow up what is left.
DEAD = 1e-3


@initializer("rs_alive", label="RS, alive coordinates", role="control", colour="#7fb8a4")
def relational_similarity_alive(insertion: InitContext, k: Count) -> InitResult:
    """RS from α that are zero in the coordinates in which their relation's map is dead."""
    models = torch.arange(len(insertion.novel))[:, None, None]
    alpha = resultants(insertion) * alive(insertion.theta0)[models, insertion.relation]
    chosen = top_k(relational_score(insertion, alpha), insertion.eligible[:, None], k)
    return first_that_can(insertion, (NONE, has_insert_triples(insertion), chosen))


def alive(theta0: Embedding) -> Tensor:
    """Whether the map of each relation stretches each coordinate to at least ``DEAD``; shape (M, R, d), bool."""
    relation, axes = theta0.relation[:, :, None], torch.eye(theta0.entity.shape[-1])
    taken = theta0.model.transform(axes, relation) - theta0.model.transform(torch.zeros_like(axes), relation)
    stretch: Tensor = vector_norm(taken, dim=-1)
    return stretch >= DEAD
