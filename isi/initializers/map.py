"""MAP and ridge: the vector that best fits the insert triples and a prior.

Each insert triple is a positive. Its expected negatives: ``ratio`` copies whose known end is a uniformly random known
entity, perhaps the true one, and ``ratio`` with another relation. Both are weights of triples in ``Evidence``.
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.linalg import inv_ex, solve
from torch.nn.functional import softplus

from isi.config import Count, NotNegative, Positive
from isi.initializers import similarity
from isi.initializers.api import InitContext, InitResult, initializer
from isi.initializers.baselines import soft_hybrid
from isi.initializers.paper import hybrid_similarity
from isi.models.scoring import padded
from isi.models.stack import Embedding, NotFinite, mapped, select

SHRINKAGE = 0.1  #: Weight of an isotropic covariance of equal trace in Σ, since the known vectors' own may be singular.
STEPS = 20  #: Of Newton's method, at most: it needs about six where a score is linear.
TOLERANCE = 1e-6  #: A step is the last if twice its predicted gain of log-probability is at most this.
ROUNDING = 1e-12  #: Relative rounding error of the objective.
HALVINGS = 10  #: Of a step, at most.
BUDGET = 2**23  #: Maximum number of elements in a product of slopes and weights in ``gram``, for each model.


@dataclass(frozen=True)
class Evidence:
    """Weights of the K = 2·R·E triples that a novel entity may have, and its prior; all float64."""

    positive: Tensor  #: shape: (M, n, K)
    negative: Tensor  #: shape: (M, n, K)
    mean: Tensor  #: μ; shape: (M, n, d)
    precision: Tensor  #: λΣ⁻¹; shape: (M, d, d)


def expected_negatives(context: InitContext, positive: Tensor, ratio: int) -> Tensor:
    """Expected count of each triple among the corrupted copies of positives, (M, n, 2, R, E); the same shape."""
    share = context.known / context.known.sum(-1, keepdim=True)
    by_end = positive.sum(-1, keepdim=True) * share[:, None, None, None]
    by_relation = (positive.sum(3, keepdim=True) - positive) / max(1, positive.shape[3] - 1)
    return ratio * (by_end + by_relation)


def covariance(context: InitContext) -> Tensor:
    """Σ of the known vectors, shrunk towards an isotropic one by ``SHRINKAGE``; shape (M, d, d), float64."""
    known = context.known.double()[..., None]
    number, entity = known.sum(1, keepdim=True), context.theta0.entity.double()
    apart = (entity - (known * entity).sum(1, keepdim=True) / number) * known
    spread = apart.mT @ apart / number
    isotropic = spread.diagonal(dim1=1, dim2=2).mean(-1)[:, None, None] * torch.eye(entity.shape[-1])
    return (1 - SHRINKAGE) * spread + SHRINKAGE * isotropic


def evidence(context: InitContext, mean: Tensor, strength: float, ratio: int) -> Evidence:
    """The evidence of the insert triples, and a prior of mean (M, n, d); ``NotFinite`` where Σ has no inverse."""
    positive = similarity.insert_triple_table(context)
    negative = expected_negatives(context, positive, ratio)
    inverse, failed = inv_ex(covariance(context))
    if failed.any():
        problem = "the known vectors are all equal and have no covariance: lower the weight decay of training"
        raise NotFinite(failed.nonzero()[:, 0].tolist(), problem)
    return Evidence(positive.flatten(2).double(), negative.flatten(2).double(), mean.double(), strength * inverse)


def most_probable(context: InitContext, prior: InitResult, strength: float, ratio: int) -> InitResult:
    """argmin Σ w⁺ softplus(-f) + Σ w⁻ softplus(f) + λ/2 (v - μ)ᵀΣ⁻¹(v - μ), by Newton's method from μ (MAP).

    Strictly convex if the score f is linear in v. Otherwise each step linearizes f around v (Gauss-Newton), and the
    result is near a local optimum. A step is halved while it increases the objective.
    """
    known, theta0 = evidence(context, prior.vectors, strength, ratio), mapped(context.theta0, Tensor.double)
    alpha = similarity.alpha_of_all_triples(theta0) if theta0.model.linear else None
    if alpha is None:  # each novel entity alone, as a stack of M · n models
        model = torch.arange(len(known.mean)).repeat_interleave(known.mean.shape[1])
        positive, negative, mean = (v.flatten(0, 1)[:, None] for v in (known.positive, known.negative, known.mean))
        known, theta0 = Evidence(positive, negative, mean, known.precision[model]), select(theta0, model)
    at, active = known.mean, torch.ones(known.mean.shape[:2], dtype=torch.bool)
    for _ in range(STEPS):
        step, gain = newton(known, theta0, at, alpha)
        at = torch.where(active[..., None], at + step_size(known, theta0, at, step)[..., None] * step, at)
        active &= gain > TOLERANCE
        if not active.any():
            break
    return replace(prior, vectors=at.view(prior.vectors.shape).to(prior.vectors.dtype), is_centroid=False)


def newton(known: Evidence, theta0: Embedding, at: Tensor, alpha: Tensor | None) -> tuple[Tensor, Tensor]:
    """The step, (M, n, d), to the quadratic model's minimum, and twice its gain, (M, n); ``alpha``: ∂f/∂v if linear."""
    slopes = score_gradients(theta0, at) if alpha is None else alpha
    weight, likely = known.positive + known.negative, padded(torch.sigmoid, scores(theta0, at))
    gradient = (weight * likely - known.positive) @ slopes + (at - known.mean) @ known.precision
    curvature = (weight * likely * (1 - likely)).float()  # in single precision, since it only shapes the step
    step = -solve(gram(slopes.float(), curvature).double() + known.precision[:, None], gradient)
    return step, -(gradient * step).sum(-1)


def step_size(known: Evidence, theta0: Embedding, at: Tensor, step: Tensor) -> Tensor:
    """The first factor of 1, ½, ¼, ... whose step does not increase the objective, else 2^-``HALVINGS``; (M, n)."""
    here, share = objective(known, theta0, at), torch.ones(at.shape[:2], dtype=at.dtype)
    for _ in range(HALVINGS):
        worse = objective(known, theta0, at + share[..., None] * step) > here * (1 + ROUNDING)
        if not worse.any():
            break
        share = torch.where(worse, share / 2, share)
    return share


def objective(known: Evidence, theta0: Embedding, at: Tensor) -> Tensor:
    """The objective of MAP at vectors (M, n, d); shape (M, n)."""
    score, apart = scores(theta0, at), at - known.mean
    loss = known.positive * softplus(-score) + known.negative * softplus(score)
    return loss.sum(-1) + (apart @ known.precision * apart).sum(-1) / 2


def scores(theta0: Embedding, at: Tensor) -> Tensor:
    """f of each triple that novel vectors, (M, n, d), may have; shape (M, n, K)."""
    models, number, relations = *at.shape[:2], theta0.relation.shape[1]
    novel, relation = at.repeat_interleave(relations, 1), theta0.relation.repeat(1, number, 1)
    as_head = theta0.model.score_tails(novel, relation, theta0.entity)
    as_tail = theta0.model.score_heads(novel, relation, theta0.entity)
    return torch.stack([ends.view(models, number, relations, -1) for ends in (as_head, as_tail)], 2).flatten(2)


def score_gradients(theta0: Embedding, at: Tensor) -> Tensor:
    """Gradient of each possible triple's f, (M, K, d), by the novel vector ``at``, one per model: (M, 1, d)."""
    entity, relation = theta0.entity[:, None], theta0.relation[:, :, None]
    shape = (*theta0.relation.shape[:2], *theta0.entity.shape[1:])
    with torch.enable_grad():
        head, tail = (at[:, :, None].expand(shape).clone().requires_grad_() for _ in range(2))
        total = theta0.model.score(head, relation, entity).sum() + theta0.model.score(entity, relation, tail).sum()
    return torch.stack(torch.autograd.grad(total, (head, tail)), 1).flatten(1, 3)


def gram(slopes: Tensor, weight: Tensor) -> Tensor:
    """Σ w s sᵀ over K triples, of slopes s, (M, K, d), and weights w, (M, n, K); shape (M, n, d, d)."""
    models, _, dimension = slopes.shape
    parts = []
    for part in torch.split(weight, max(1, BUDGET // slopes[0].numel()), 1):
        weighted = (slopes[:, :, None] * part.mT[..., None]).flatten(2)  # (M, K, n · d)
        parts.append((slopes.mT @ weighted).view(models, dimension, -1, dimension).transpose(1, 2))
    return torch.cat(parts, 1)


_PRIOR: dict[str, list[Any]] = {"strength": [0.05, 0.1, 0.2, 0.5, 1.0], "ratio": [1, 3, 9]}


@initializer("map_ers", label="MAP, ERS", role="baseline", colour="#d6604d",
             needs=("words", "insert_triples", "inverse"),
             defaults={"k": 9, "candidates": 30, "strength": 0.2, "ratio": 1},
             grid={"k": [9], "candidates": [30], **_PRIOR})  # fmt: skip
def map_around_ers(context: InitContext, k: Count, candidates: Count, strength: Positive, ratio: Count) -> InitResult:
    """MAP, ERS: the most probable vector given the insert triples and a prior at the vector of ERS."""
    return most_probable(context, hybrid_similarity(context, k, candidates), strength, ratio)


@initializer("map_mean", label="MAP, mean", role="baseline", colour="#f4a582", needs=("insert_triples",),
             defaults={"strength": 0.1, "ratio": 1}, grid=_PRIOR)  # fmt: skip
def map_around_mean(context: InitContext, strength: Positive, ratio: Count) -> InitResult:
    """MAP, mean: the most probable vector given the insert triples and a prior at the known centroid."""
    return most_probable(context, _mean_of_known(context), strength, ratio)


@initializer("map_soft_hybrid", label="MAP", role="baseline", colour="#b2182b",
             needs=("words", "insert_triples", "inverse"),
             defaults={"word_weight": 16.0, "relation_weight": 16.0, "strength": 0.2, "ratio": 1},
             grid={"word_weight": [12.0, 16.0], "relation_weight": [8.0, 16.0], **_PRIOR})  # fmt: skip
def map_around_soft_hybrid(
    context: InitContext, word_weight: NotNegative, relation_weight: NotNegative, strength: Positive, ratio: Count
) -> InitResult:
    """MAP: the most probable vector given the insert triples and a prior at the soft hybrid's vector."""
    return most_probable(context, soft_hybrid(context, word_weight, relation_weight), strength, ratio)


@initializer("ridge", label="Ridge", role="baseline", colour="#8c6d46",
             needs=("insert_triples", "inverse", "linear_score"), defaults={"strength": 1e-4, "ratio": 3},
             grid={"strength": [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1], "ratio": [1, 3, 9]})  # fmt: skip
def ridge(context: InitContext, strength: Positive, ratio: Count) -> InitResult:
    """Ridge: the vector whose scores are nearest to 1 for insert triples and to 0 for their corruptions."""
    # argmin Σ w (y - ⟨v, α⟩)² + λ (v - μ)ᵀΣ⁻¹(v - μ), with y = 1 for positives, 0 for negatives; μ: the known centroid
    prior = _mean_of_known(context)
    known = evidence(context, prior.vectors, strength, ratio)
    alpha = similarity.alpha_of_all_triples(mapped(context.theta0, Tensor.double))
    weight, mean = known.positive + known.negative, known.mean
    residual = known.positive - weight * (mean @ alpha.mT)
    step = solve(gram(alpha, weight) + known.precision[:, None], residual @ alpha)
    return replace(prior, vectors=(mean + step).to(prior.vectors.dtype), is_centroid=False)


def _mean_of_known(context: InitContext) -> InitResult:
    """The centroid of the known entities, marked as a fallback if there are no insert triples."""
    return similarity.centroid_of_first(context, triples=lambda: similarity.all_known(context))
