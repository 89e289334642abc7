"""Newton's method for vectors that determine the scores of weighted
triples and have a normal prior.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor
from torch.linalg import cholesky_ex, solve, vector_norm
from torch.nn.functional import normalize, softplus

from isi.models.scoring import Interaction, padded

STEPS = 20  #: Of Newton's method, at most: it needs about six where a score is linear.
#: Maximum number of triples in the Hessian, those of most curvature. It counts the others as
#: one multiple of the unit matrix with their trace.
CURVED = 2**10
#: A step is the last if twice its predicted gain of log-probability is at most this.
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
    #: numbers of facts m of G queries (v, r, ?), whose loss is a softmax; shape (B, G), float64
    asked: Tensor | None = None
    #: number of candidate answers of each of these queries, which are the last of the C triples.
    #: The offset of a candidate is the log of its weight.
    candidates: int = 0
    #: number of such facts that each triple is; shape: (B, C)
    answers: Tensor | float = 0.0
    #: vectors, (B, d), under the model's constraint; None: all vectors are allowed
    constrain: Callable[[Tensor], Tensor] | None = None

    def allowed(self, at: Tensor) -> Tensor:
        """Vectors, (B, d), under the constraint."""
        return at if self.constrain is None else self.constrain(at)

    def log_odds(self, at: Tensor) -> Tensor:
        """o = slope · f + offset of each triple with vectors (B, d); shape (B, C)."""
        return self.slope * self.score.scores(at.float()).double() + self.offset

    def slopes(self, at: Tensor) -> Tensor:
        """∂f/∂v of each triple at vectors (B, d); shape (B, C, d)."""
        return self.score.slopes(at.float())

    def objective(self, odds: Tensor, at: Tensor) -> Tensor:
        """Σ w⁺ softplus(-o) + Σ w⁻ softplus(o) + λ/2 (v - μ)ᵀΣ⁻¹(v - μ), and the loss of ``asked``,
        Σ m log Σ exp(o of candidates) - Σ o of answers; shapes (B, C), (B, d), result (B,).
        """
        apart = at - self.mean
        prior = (apart[:, None] @ self.precision @ apart[..., None]).flatten()
        loss = (self.positive * softplus(-odds) + self.negative * softplus(odds)).sum(-1)
        if self.asked is not None:
            log_z = self._candidates(odds).logsumexp(-1)
            loss = loss + (self.asked * log_z).sum(-1) - (self.answers * odds).sum(-1)
        return loss + prior / 2

    def derivatives(self, odds: Tensor) -> tuple[Tensor, Tensor]:
        """First derivative of the loss by each score, and the second one, (B, C) each; those of
        two candidates of ``asked`` are in ``between_candidates``.
        """
        weight, likely = self.positive + self.negative, padded(torch.sigmoid, odds)
        first, second = weight * likely - self.positive, weight * likely * (1 - likely)
        if self.asked is not None:
            expected = (self.asked[..., None] * self._likely(odds)).flatten(1)
            first = first - self.answers
            first[:, -expected.shape[1] :] += expected
            second[:, -expected.shape[1] :] += expected
        return self.slope * first, self.slope**2 * second

    def between_candidates(self, odds: Tensor, slopes: Tensor) -> Tensor | float:
        """What the second derivatives by scores of two candidates add to the Hessian; (B, d, d)."""
        if self.asked is None:
            return 0.0
        likely = self._likely(odds).float()
        of_candidates = slopes[:, slopes.shape[1] - likely[0].numel() :]
        of_candidates = of_candidates.reshape(*likely.shape, slopes.shape[2])
        mean = (likely[..., None, :] @ of_candidates)[..., 0, :]
        return -(self.slope**2) * gram(mean, self.asked.float())

    def _likely(self, odds: Tensor) -> Tensor:
        """The softmax over the candidates of each query of ``asked``; (B, G, candidates)."""
        return torch.softmax(self._candidates(odds), -1)

    def _candidates(self, odds: Tensor) -> Tensor:
        """The log odds of the candidates of each query of ``asked``; shape (B, G, candidates)."""
        batch, triples = odds.shape
        queries = 0 if self.asked is None else self.asked.shape[1]
        candidates = odds[:, triples - queries * self.candidates :]
        return candidates.reshape(batch, queries, self.candidates)


def newton(problem: Problem, start: Tensor | None = None) -> Tensor:
    """argmin of the objective over allowed vectors, (B, d), by Newton's method from ``start``,
    (B, d), or μ.

    Strictly convex if the score f is linear in v. Otherwise each step linearizes f around v
    (Gauss-Newton), and the result is near a local optimum. A step is halved while it increases the
    objective. With a constraint, each step follows its slope, and what it leads to is constrained.
    """
    at = problem.allowed(problem.mean if start is None else start)
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
    first, second = problem.derivatives(odds)
    gradient = (first.float()[:, None] @ slopes)[:, 0].double()
    gradient += (problem.precision @ (at - problem.mean)[..., None])[..., 0]
    curved = curvature(slopes, second.float()) + problem.between_candidates(odds, slopes)
    hessian = curved.double() + problem.precision
    if problem.constrain is not None:
        gradient, hessian = along(problem.constrain, at, gradient, hessian)
    step = -solve(hessian, gradient)
    return step, -(gradient * step).sum(-1)


def curvature(slopes: Tensor, second: Tensor) -> Tensor:
    """``gram`` of slopes, (B, C, d), and weights, (B, C); of more than ``CURVED`` triples, those of
    least weight enter with their trace alone; shape (B, d, d).
    """
    if second.shape[1] <= CURVED:
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
