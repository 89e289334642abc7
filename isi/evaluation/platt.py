"""Logistic curves of scores (Platt 1999): from the score of a triple to its probability."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import softplus

MOST_UNKNOWN = 2**14  #: Maximum number of unknown answers per curve.
#: Of Newton's method: maximum number of steps, and the relative gain at which it stops.
STEPS, GAIN = 50, 1e-10


@dataclass(frozen=True)
class PlattCurve:
    """probability = σ(slope · score + offset)."""

    slope: float
    offset: float

    def __call__(self, scores: Tensor) -> Tensor:
        return torch.sigmoid(self.slope * scores.double() + self.offset)


def fit_platt(scores: Tensor, known: Tensor) -> PlattCurve:
    """Fit a logistic curve to the scores of answers, (N,),
    and whether they are ``known``, (N,), bool.

    Targets are Platt's, (n₊ + 1) / (n₊ + 2) and 1 / (n₋ + 2), which keep the curve finite if scores
    separate known from unknown answers. At most ``MOST_UNKNOWN`` unknown answers, spread evenly
    over the sorted scores, represent them all.
    """
    right, unknown = scores[known].double(), scores[~known].double().sort().values
    number, step = len(unknown), -(-len(unknown) // MOST_UNKNOWN) or 1
    unknown = unknown[step // 2 :: step]
    inputs = torch.cat([right, unknown])
    target = torch.full((len(inputs),), 1 / (number + 2)).double()
    target[: len(right)] = (len(right) + 1) / (len(right) + 2)
    weight = torch.full_like(target, number / max(1, len(unknown)))
    weight[: len(right)] = 1.0
    centre, spread = inputs.mean(), inputs.std(correction=0).clamp(min=1e-12)
    fit = _logistic_regression(
        torch.stack([(inputs - centre) / spread, torch.ones_like(inputs)], 1), target, weight
    )
    slope = (fit[0] / spread).item()
    if slope <= 0:  # probability must not fall with the score
        return PlattCurve(0.0, torch.logit((weight * target).sum() / weight.sum()).item())
    return PlattCurve(slope, (fit[1] - fit[0] * centre / spread).item())


def _logistic_regression(inputs: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Coefficients, (2,), for inputs (N, 2), by Newton's method;
    a step is halved until the loss does not rise.
    """

    def loss_of(coefficients: Tensor) -> float:
        score = inputs @ coefficients
        return (weight * (softplus(score) - target * score)).sum().item()

    coefficients = torch.zeros(2, dtype=torch.float64)
    loss = loss_of(coefficients)
    for _ in range(STEPS):
        likely = torch.sigmoid(inputs @ coefficients)
        gradient = inputs.T @ (weight * (likely - target))
        hessian = (inputs * (weight * likely * (1 - likely))[:, None]).T @ inputs
        hessian = hessian + 1e-9 * torch.eye(2, dtype=coefficients.dtype)
        step, share = torch.linalg.solve(hessian, gradient), 1.0
        while (after := loss_of(coefficients - share * step)) > loss and share > GAIN:
            share /= 2
        coefficients, gain, loss = coefficients - share * step, loss - after, after
        if gain <= GAIN * abs(loss):
            break
    return coefficients
