"""MAP: the vector that best fits the triples of ``evidence`` and a prior at a mean of known
vectors.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal

import torch
from torch import Tensor
from torch.linalg import inv_ex

from isi.config import Count, NotNegative, Positive
from isi.initializers import similarity
from isi.initializers.api import NONE, InitResult, initializer
from isi.initializers.baselines import (
    entity_relation_average,
    soft_hybrid,
    soft_relational_similarity,
)
from isi.initializers.context import InitContext
from isi.initializers.evidence import Evidence, evidence_of, spread
from isi.initializers.newton import Problem, newton, score_of
from isi.initializers.paper import kind_mean, mean
from isi.models.stack import NotFinite, rows

#: Weight of an isotropic covariance of equal trace in Σ, since the known vectors' own may be
#: singular.
SHRINKAGE = 0.1
VECTORS = 2**11  #: Maximum number of known vectors, evenly spaced by id, from which Σ is computed.
#: Maximum number of elements in the vectors of the triples of all entities solved together.
BUDGET = 2**20


def covariance(context: InitContext) -> Tensor:
    """Σ of ≤ ``VECTORS`` known vectors, shrunk towards an isotropic one by ``SHRINKAGE``;
    (M, d, d), float64.
    """
    entity, weight = spread(context.known.double(), VECTORS)
    share = (weight / weight.sum(-1, keepdim=True))[..., None]
    vectors = rows(context.theta0.entity, entity).double()
    apart = vectors - (share * vectors).sum(1, keepdim=True)
    full = apart.mT @ (apart * share)
    isotropic = full.diagonal(dim1=1, dim2=2).mean(-1)[:, None, None] * torch.eye(vectors.shape[-1])
    return (1 - SHRINKAGE) * full + SHRINKAGE * isotropic


def precision_of(context: InitContext) -> Tensor:
    """Σ⁻¹ of the known vectors, (M, d, d), float64; ``NotFinite`` where Σ has no inverse."""
    inverse, failed = inv_ex(covariance(context))
    if failed.any():
        problem = (
            "the known vectors are all equal and have no covariance: "
            "lower the weight decay of training"
        )
        raise NotFinite(failed.nonzero()[:, 0].tolist(), problem)
    return inverse  # type: ignore[no-any-return]


def problems(
    context: InitContext, weighted: Evidence, prior: Tensor, strength: float
) -> Iterator[Problem]:
    """The problems of all M · n novel entities in order, in batches of ``BUDGET``;
    ``prior``: its mean μ, (M, n, d).
    """
    models, number, dimension = prior.shape
    precision = strength * precision_of(context)
    places = torch.arange(models * number)
    batch = max(1, BUDGET // (weighted.other.shape[-1] * dimension))
    for part in torch.split(places, batch):
        yield problem_of(context, weighted, prior, precision, part)


def problem_of(
    context: InitContext, weighted: Evidence, prior: Tensor, precision: Tensor, place: Tensor
) -> Problem:
    """The problem of the novel entities at some of M · n places, (B,); shapes as in ``problems``,
    ``precision``: (M, d, d).
    """
    theta0, model = context.theta0, place // prior.shape[1]

    def of(values: Tensor) -> Tensor:
        return values.flatten(0, 1)[place]

    ends = (
        of(weighted.is_tail)[..., None],
        theta0.relation[model[:, None], of(weighted.relation)],
        theta0.entity[model[:, None], of(weighted.other)],
    )
    return Problem(
        of(weighted.positive),
        of(weighted.negative),
        of(prior.double()),
        precision[model],
        score_of(theta0.model, *ends),
        slope=context.scale.slope,
        offset=context.scale.offset,
        start=None if context.start is None else of(context.start.double()),
        constrain=None if theta0.model.is_free else theta0.model.constrain,
    )


def most_probable(
    context: InitContext,
    prior: InitResult,
    strength: float,
    ratio: int,
    known_negatives: float = 0.0,
) -> InitResult:
    """The minimum of ``Problem.objective`` for each novel entity:
    its maximum a posteriori vector (MAP).
    """
    weighted = evidence_of(context, ratio, known_negatives)
    batches = problems(context, weighted, prior.vectors, strength)
    vectors = torch.cat([newton(problem) for problem in batches]).view(prior.vectors.shape)
    return replace(prior, vectors=vectors.to(prior.vectors.dtype), is_centroid=False)


_PRIOR: dict[str, list[Any]] = {"strength": [0.05, 0.1, 0.2, 0.5, 1.0], "ratio": [1, 3, 9]}


#: The initializer whose vector is the prior mean.
Prior = Literal["soft_hybrid", "soft_rs", "er_avg", "kind_mean", "mean"]

#: Settings for embeddings on which another prior, or more weight on it or on known triples pays:
#: prior, strength, known_negatives, ratio.
_COMPARED: list[tuple[Prior, float, float, int]] = [
    ("soft_hybrid", 3.0, 10.0, 3),
    ("soft_rs", 0.3, 1.0, 1),
    ("er_avg", 3.0, 3.0, 1),
    ("soft_rs", 3.0, 10.0, 1),
    ("soft_hybrid", 1.0, 3.0, 3),
    ("mean", 1.0, 3.0, 1),
]
_SETTINGS = [
    {"prior": prior, "strength": strength, "known_negatives": weight, "ratio": ratio}
    for prior, strength, weight, ratio in _COMPARED
]


@initializer(
    "map",
    label="MAP",
    role="baseline",
    cost="newton",
    needs=("insert_triples",),
    defaults={
        "word_weight": 16.0,
        "relation_weight": 8.0,
        "strength": 0.5,
        "ratio": 3,
        "known_negatives": 0.3,
        "prior": "soft_hybrid",
    },
    grid={
        "word_weight": [16.0],
        "relation_weight": [8.0],
        "strength": [0.2, 0.5, 1.0, 3.0],
        "ratio": [1, 3, 9],
        "known_negatives": [0.1, 0.3, 1.0],
        "prior": ["soft_hybrid"],
    },
    calibration=_SETTINGS,
)
def maximum_a_posteriori(
    context: InitContext,
    word_weight: NotNegative,
    relation_weight: NotNegative,
    strength: Positive,
    ratio: Count,
    known_negatives: NotNegative,
    prior: Prior = "soft_hybrid",
) -> InitResult:
    """MAP: the most probable vector given insert triples,
    corrupted known triples and a prior at the soft hybrid.
    """
    if prior == "soft_hybrid" or not context.theta0.model.invertible:
        around = soft_hybrid(context, word_weight, relation_weight)
    else:
        around = _PRIORS[prior](context)
    has_triples = similarity.has_insert_triples(context)
    around = replace(around, fallback=around.fallback.masked_fill(has_triples, NONE))
    return most_probable(context, around, strength, ratio, known_negatives)


def _soft_rs(context: InitContext) -> InitResult:
    """Soft RS at its default temperature."""
    return soft_relational_similarity(context, 0.02)


_PRIORS = {
    "soft_rs": _soft_rs,
    "er_avg": entity_relation_average,
    "kind_mean": kind_mean,
    "mean": mean,
}


@initializer(
    "map_own_facts",
    label="MAP, own facts",
    role="baseline",
    cost="newton",
    needs=("words", "insert_triples", "inverse"),
    defaults={"word_weight": 16.0, "relation_weight": 16.0, "strength": 0.2, "ratio": 1},
    grid={"word_weight": [12.0, 16.0], "relation_weight": [8.0, 16.0], **_PRIOR},
)
def map_of_own_facts(
    context: InitContext,
    word_weight: NotNegative,
    relation_weight: NotNegative,
    strength: Positive,
    ratio: Count,
) -> InitResult:
    """MAP, own facts: MAP without the known triples that the novel entity corrupts (β = 0)."""
    return most_probable(
        context, soft_hybrid(context, word_weight, relation_weight), strength, ratio
    )
