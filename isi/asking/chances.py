"""Chances: scores made comparable over queries.

The chance of an answer is the share of known answers among those that score as it does (Platt 1999): a logistic curve
of the score, one for each relation and slot, through all answers about entities that stand in known triples of the
relation, by entities of the kinds that do. What is true but unknown counts as wrong there.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.asking.model import Model
from isi.graph import HEAD, TAIL

#: Answers that a curve is drawn through, at most; and entities that are asked about.
ANSWERS, ASKED = 2**19, 256
#: Answers that are not known, at most, in one curve.
OTHERS = 2**14
#: Steps of Newton's method, at most, and the gain at which it stops.
STEPS, GAIN = 50, 1e-10


@dataclass(frozen=True)
class Curve:
    """chance = σ(slope · score + offset)."""

    slope: float
    offset: float

    def __call__(self, scores: Tensor) -> Tensor:
        return torch.sigmoid(self.slope * scores.double() + self.offset)


def curve_of(model: Model, relation: int, slot: int) -> Curve | None:
    """The curve of a relation where one slot is asked for; null where nothing is known of the relation."""
    given = model.stands_in(relation, HEAD if slot == TAIL else TAIL)
    if not given:
        return None
    most = max(1, min(ASKED, ANSWERS // len(model.kept.entities)))
    some, candidates = given[:: -(-len(given) // most)], model.candidates(relation, slot)
    scores = model.scores(torch.tensor(some), relation, slot).double()
    known = torch.zeros(scores.shape, dtype=torch.bool)
    for row, entity in enumerate(some):
        known[row, sorted(model.answers[entity, relation, slot])] = True
    return fitted(scores[:, candidates].flatten(), known[:, candidates].flatten())


def fitted(scores: Tensor, known: Tensor) -> Curve:
    """The most probable logistic curve through answers of which some are known; both of shape (N,).

    Targets are Platt's, (n₊ + 1) / (n₊ + 2) and 1 / (n₋ + 2), which keep the curve finite where scores part the known
    from the others. Of many others, evenly many over their scores stand for all.
    """
    right, others = scores[known].double(), scores[~known].double().sort().values
    number, every = len(others), -(-len(others) // OTHERS) or 1
    others = others[every // 2 :: every]
    inputs, target = torch.cat([right, others]), torch.full((len(right) + len(others),), 1 / (number + 2)).double()
    target[: len(right)] = (len(right) + 1) / (len(right) + 2)
    weight = torch.full_like(target, number / max(1, len(others)))
    weight[: len(right)] = 1.0
    centre, spread = inputs.mean(), inputs.std(correction=0).clamp(min=1e-12)
    at = _most_probable(torch.stack([(inputs - centre) / spread, torch.ones_like(inputs)], 1), target, weight)
    slope = (at[0] / spread).item()
    if slope <= 0:  # what scores higher is never less probable
        return Curve(0.0, torch.logit((weight * target).sum() / weight.sum()).item())
    return Curve(slope, (at[1] - at[0] * centre / spread).item())


def _most_probable(inputs: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Coefficients of a logistic curve by Newton's method, a step halved until it gains; shapes (N, 2), (N,), (N,)."""
    at = torch.zeros(2, dtype=torch.float64)
    loss = _loss(inputs, target, weight, at)
    for _ in range(STEPS):
        likely = torch.sigmoid(inputs @ at)
        gradient = inputs.T @ (weight * (likely - target))
        bend = (inputs * (weight * likely * (1 - likely))[:, None]).T @ inputs + 1e-9 * torch.eye(2, dtype=at.dtype)
        step, share = torch.linalg.solve(bend, gradient), 1.0
        while (after := _loss(inputs, target, weight, at - share * step)) > loss and share > GAIN:
            share /= 2
        at, gain, loss = at - share * step, loss - after, after
        if gain <= GAIN * abs(loss):
            break
    return at


def _loss(inputs: Tensor, target: Tensor, weight: Tensor, at: Tensor) -> float:
    score = inputs @ at
    return (weight * (torch.nn.functional.softplus(score) - target * score)).sum().item()
