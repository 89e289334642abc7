"""The most probable vectors, given weighted triples and a normal prior: scores of triples by a
vector, the objective, and Newton's method.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor
from torch.linalg import cholesky_ex, solve, vector_norm
from torch.nn.functional import normalize, softplus

from isi.models.model import Model, RelationMapModel
from isi.models.scoring import Interaction, padded

STEPS = 20  #: Of Newton's method, at most: it needs about six where a score is linear.
#: Maximum number of triples in the Hessian, those of most curvature. It counts the others as
#: one multiple of the unit matrix with their trace.
CURVED = 2**10
#: Nats: a step is the last if twice its predicted gain of log-probability is at most this.
TOLERANCE = 1e-6
ROUNDING = 1e-6  #: Relative rounding error of the objective, whose scores are in single precision.
HALVINGS = 10  #: Of a step, at most.
CLOSE = 3e-3  #: Nats. A halved step is the last, too, if it lowers the objective by less.
#: Share of a vector's length by which it is moved before a constraint's slope is taken: at the
#: border of a ball, the slope depends on whether the objective leads in or out.
NUDGE = 1e-6
TINY = 1e-12  #: Minimum squared length of a vector by which a curvature is divided.


class Score(Protocol):
    """The score f of each of C triples by vectors v, (B, d), float32."""

    def scores(self, at: Tensor) -> Tensor:
        """f; shape (B, C)."""

    def slopes(self, at: Tensor) -> Tensor:
        """∂f/∂v; shape (B, C, d)."""


@dataclass(frozen=True)
class LinearScore:
    """f = ⟨v, α⟩; ``alpha``: (B, C, d)."""

    alpha: Tensor

    def scores(self, at: Tensor) -> Tensor:
        return (self.alpha @ at[..., None])[..., 0]

    def slopes(self, at: Tensor) -> Tensor:  # noqa: ARG002
        return self.alpha


@dataclass(frozen=True)
class MappedScore:
    """f = interaction(α, v), where α is the known end, mapped by the relation;
    ``alpha``: (B, C, d).
    """

    interaction: Interaction
    alpha: Tensor

    def scores(self, at: Tensor) -> Tensor:
        return self.interaction.rows(self.alpha, at[:, None])[0]

    def slopes(self, at: Tensor) -> Tensor:
        score, backward = self.interaction.rows(self.alpha, at[:, None])
        return backward(torch.ones_like(score))[1]


@dataclass(frozen=True)
class AnyScore:
    """f of vectors for each triple, (B, C, d), with slopes by autograd."""

    function: Callable[[Tensor], Tensor]
    triples: int  #: C

    def scores(self, at: Tensor) -> Tensor:
        return self.function(self._for_each(at))

    def slopes(self, at: Tensor) -> Tensor:
        with torch.enable_grad():
            vectors = self._for_each(at).clone().requires_grad_()
            total = self.function(vectors).sum()
        return torch.autograd.grad(total, vectors)[0]

    def _for_each(self, at: Tensor) -> Tensor:
        return at[:, None].expand(-1, self.triples, -1)


def score_of(model: Model, is_tail: Tensor, relation: Tensor, other: Tensor) -> Score:
    """f of triples by vectors of the novel entities; shapes (B, C, 1), (B, C, w), (B, C, d)."""
    if model.linear:
        return LinearScore(anchors(model, is_tail, relation, other))
    if isinstance(model, RelationMapModel):
        return MappedScore(model.interaction, anchors(model, is_tail, relation, other))

    def score(novel: Tensor) -> Tensor:
        return model.score(
            torch.where(is_tail, other, novel), relation, torch.where(is_tail, novel, other)
        )

    return AnyScore(score, other.shape[1])


def anchors(model: Model, is_tail: Tensor, relation: Tensor, other: Tensor) -> Tensor:
    """α of triples, (B, C, d): their known ends, mapped by the relation;
    shapes as in ``score_of``.
    """
    alpha, at = torch.empty_like(other), is_tail[..., 0]
    alpha[at] = model.transform(other[at], relation[at])
    alpha[~at] = model.transform_tail(other[~at], relation[~at])
    return alpha


@dataclass(frozen=True)
class Problem:
    """The objective of B vectors v, each with C triples.
    Vectors of triples are float32, all other numbers float64.
    """

    positive: Tensor  #: w⁺; shape: (B, C)
    negative: Tensor  #: w⁻; shape: (B, C)
    mean: Tensor  #: μ; shape: (B, d)
    precision: Tensor  #: λΣ⁻¹; shape: (B, d, d)
    score: Score
    slope: float = 1.0  #: of log odds
    offset: Tensor | float = 0.0  #: of log odds; shape: (B, C)
    start: Tensor | None = None  #: where Newton's method starts, (B, d); None: at μ
    #: vectors, (B, d), under the model's constraint; None: all vectors are allowed
    constrain: Callable[[Tensor], Tensor] | None = None

    def allowed(self, at: Tensor) -> Tensor:
        """Vectors, (B, d), under the constraint."""
        return at if self.constrain is None else self.constrain(at)

    def log_odds(self, at: Tensor) -> Tensor:
        """o = slope · f + offset of each triple with vectors (B, d); shape (B, C), float64."""
        return self.slope * self.score.scores(at.float()).double() + self.offset

    def slopes(self, at: Tensor) -> Tensor:
        """∂f/∂v of each triple at vectors (B, d); shape (B, C, d)."""
        return self.score.slopes(at.float())

    def objective(self, odds: Tensor, at: Tensor) -> Tensor:
        """Σ w⁺ softplus(-o) + Σ w⁻ softplus(o) + λ/2 (v - μ)ᵀΣ⁻¹(v - μ), by log odds o, (B, C), at
        vectors (B, d); shape (B,).
        """
        apart = at - self.mean
        prior = (apart[:, None] @ self.precision @ apart[..., None]).flatten()
        loss = (self.positive * softplus(-odds) + self.negative * softplus(odds)).sum(-1)
        return loss + prior / 2

    def quadratic(self, odds: Tensor, slopes: Tensor) -> tuple[Tensor, Tensor]:
        """Gradient, (B, d), and Hessian, (B, d, d), of the loss, by log odds and slopes."""
        weight, likely = self.positive + self.negative, padded(torch.sigmoid, odds)
        first, second = weight * likely - self.positive, weight * likely * (1 - likely)
        first, second = self.slope * first, self.slope**2 * second
        gradient = (first.float()[:, None] @ slopes)[:, 0]
        return gradient.double(), curvature(slopes, second.float()).double()


def newton(problem: Problem) -> Tensor:
    """argmin of the objective over allowed vectors, (B, d), by Newton's method.

    Strictly convex if the score f is linear in v. Otherwise each step linearizes f around v
    (Gauss-Newton), and the result is near a local optimum. A step is halved while it increases the
    objective. With a constraint, each step follows its slope, and what it leads to is constrained.
    """
    at = problem.allowed(problem.mean if problem.start is None else problem.start)
    active = torch.ones(len(at), dtype=torch.bool)
    odds, slopes = problem.log_odds(at), problem.slopes(at)
    for _ in range(STEPS):
        step, gain = newton_step(problem, at, odds, slopes)
        share, decrease = step_size(problem, at, odds, step)
        there = problem.allowed(at + share[:, None] * step)
        at = torch.where(active[:, None], there, at)
        active &= (gain > TOLERANCE) & ((share == 1) | (decrease >= CLOSE))
        if not active.any():
            break
        odds, slopes = problem.log_odds(at), problem.slopes(at)
    return at


def newton_step(
    problem: Problem, at: Tensor, odds: Tensor, slopes: Tensor
) -> tuple[Tensor, Tensor]:
    """The step, (B, d), to the minimum of the quadratic model of the objective,
    and twice its gain, (B,).
    """
    gradient, hessian = problem.quadratic(odds, slopes)
    gradient += (problem.precision @ (at - problem.mean)[..., None])[..., 0]
    hessian += problem.precision
    if problem.constrain is not None:
        gradient, hessian = along(problem.constrain, at, gradient, hessian)
    step = -solve(hessian, gradient)
    return step, -(gradient * step).sum(-1)


def curvature(slopes: Tensor, second: Tensor) -> Tensor:
    """``gram`` of slopes, (B, C, d), and weights, (B, C); of more than ``CURVED`` triples, those of
    least weight enter with their trace alone; shape (B, d, d).
    """
    if second.shape[1] <= 4 * CURVED:  # to choose takes time, too
        return gram(slopes, second)
    largest, place = second.topk(CURVED, sorted=False)
    chosen = slopes.gather(1, place[..., None].expand(-1, -1, slopes.shape[2]))
    square = (slopes.square().sum(-1) * second.scatter(1, place, 0.0)).sum(-1)
    rest = square[:, None, None] / slopes.shape[2] * torch.eye(slopes.shape[2])
    return gram(chosen, largest) + rest


def along(
    constrain: Callable[[Tensor], Tensor], at: Tensor, gradient: Tensor, hessian: Tensor
) -> tuple[Tensor, Tensor]:
    """Gradient, (B, d), and Hessian, (B, d, d), of an objective of ``constrain(v)``, from those of
    the objective of v, g and H, at allowed vectors, (B, d).

    With J = ∂constrain/∂v, a little down the slope, the gradient is Jᵀg. The Hessian is JᵀHJ; plus
    (I - J)ᵀH(I - J), so that it has an inverse; plus κJᵀJ with κ = -⟨v, (I - J)g⟩ / ‖v‖², which is
    due to the curvature of a sphere, where the sum has a minimum.
    """
    length = vector_norm(at, dim=-1, keepdim=True)
    below = at - NUDGE * length * normalize(gradient, dim=-1)
    slope = jacobian(constrain, below)
    half = hessian @ slope
    flat = hessian - half - half.mT + 2 * slope.mT @ half
    out = gradient - (slope @ gradient[..., None])[..., 0]
    curvature = -(at * out).sum(-1, keepdim=True) / length.square().clamp(min=TINY)
    curved = flat + curvature[..., None] * (slope.mT @ slope)
    has_minimum = cholesky_ex(curved).info == 0
    return (gradient[:, None] @ slope)[:, 0], torch.where(has_minimum[:, None, None], curved, flat)


def jacobian(function: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
    """J[b, i, j] = ∂ function(v)[b, i] / ∂ v[b, j], (B, d, d), of a function of rows, at (B, d)."""
    with torch.enable_grad():
        vectors = at.detach().requires_grad_()
        values = function(vectors)
    columns = torch.eye(at.shape[-1], dtype=at.dtype)[:, None].expand(-1, len(at), -1)
    rows: Tensor = torch.autograd.grad(values, vectors, columns, is_grads_batched=True)[0]
    return rows.transpose(0, 1)


def step_size(problem: Problem, at: Tensor, odds: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
    """The first factor of 1, ½, ¼, ... whose step does not increase the objective,
    else 2^-``HALVINGS``; (B,).

    And the decrease of the objective by the last factor that was tried, (B,).
    """
    here, share = problem.objective(odds, at), torch.ones(len(at), dtype=at.dtype)
    for _ in range(HALVINGS):
        there = problem.allowed(at + share[:, None] * step)
        after = problem.objective(problem.log_odds(there), there)
        worse = after > here * (1 + ROUNDING)
        if not worse.any():
            break
        share = torch.where(worse, share / 2, share)
    return share, here - after


def gram(slopes: Tensor, weight: Tensor) -> Tensor:
    """Σ w s sᵀ over C cells, of slopes s, (B, C, d), and weights w, (B, C); shape (B, d, d)."""
    return slopes.mT @ (slopes * weight[..., None])
