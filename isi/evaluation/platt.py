"""Logistic curves of scores (Platt 1999): from the score of a triple to its probability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

MOST_UNKNOWN = 2**14  #: Maximum number of unknown answers per curve.
#: Of a fit near another curve: the weight of half the squared distance of both coefficients, in
#: units of the scores' standard deviation. They are expected within about two of each other.
NEARNESS = 0.25
#: Of Newton's method: maximum number of steps, and the relative gain at which it stops.
STEPS, GAIN = 50, 1e-10


@dataclass(frozen=True)
class PlattCurve:
    """probability = σ(slope · score + offset)."""

    slope: float
    offset: float

    def __call__(self, scores: np.ndarray) -> np.ndarray:
        return _sigmoid(self.slope * scores.astype(np.float64) + self.offset)


@dataclass(frozen=True)
class Curves:
    """Curves of relations, and one for those without their own."""

    of_relation: Mapping[int, PlattCurve]
    of_all: PlattCurve

    def of(self, relation: int) -> PlattCurve:
        return self.of_relation.get(relation, self.of_all)

    def __call__(self, scores: np.ndarray, relations: np.ndarray) -> np.ndarray:
        """Probabilities of triples, by their scores and the ids of their relations;
        all of shape (T,).
        """
        probabilities = self.of_all(scores)
        for relation, curve in self.of_relation.items():
            same = relations == relation
            probabilities[same] = curve(scores[same])
        return probabilities

    def stored(self) -> dict[str, list[float]]:
        """Slopes and offsets, as JSON holds them: of ``all``, and by the id of a relation.

        Example:
            >>> curves = Curves({3: PlattCurve(2.0, -1.0)}, PlattCurve(1.0, 0.0))
            >>> curves.stored()
            {'all': [1.0, 0.0], '3': [2.0, -1.0]}
            >>> Curves.of_stored(curves.stored()) == curves
            True
        """
        of_relation = {str(relation): curve for relation, curve in self.of_relation.items()}
        curves = {"all": self.of_all, **of_relation}
        return {key: [curve.slope, curve.offset] for key, curve in curves.items()}

    @classmethod
    def of_stored(cls, stored: Mapping[str, Sequence[float]]) -> Curves:
        """The curves that ``stored`` gives."""
        curves = {key: PlattCurve(*numbers) for key, numbers in stored.items()}
        of_all = curves.pop("all")
        return cls({int(relation): curve for relation, curve in curves.items()}, of_all)


def fit_platt(scores: np.ndarray, known: np.ndarray, near: PlattCurve | None = None) -> PlattCurve:
    """Fit a logistic curve to the scores of answers, (N,),
    and whether they are ``known``, (N,), bool.

    ``near``: the curve from which few answers do not lead far away.

    Targets are Platt's, (n₊ + 1) / (n₊ + 2) and 1 / (n₋ + 2), which keep the curve finite if scores
    separate known from unknown answers. At most ``MOST_UNKNOWN`` unknown answers, spread evenly
    over the sorted scores, represent them all.
    """
    numbers = scores.astype(np.float64)
    right, unknown = numbers[known], np.sort(numbers[~known])
    number, step = len(unknown), -(-len(unknown) // MOST_UNKNOWN) or 1
    unknown = unknown[step // 2 :: step]
    inputs = np.concatenate([right, unknown])
    target = np.full(len(inputs), 1 / (number + 2))
    target[: len(right)] = (len(right) + 1) / (len(right) + 2)
    weight = np.full(len(inputs), number / max(1, len(unknown)))
    weight[: len(right)] = 1.0
    centre, spread = inputs.mean(), max(inputs.std(), 1e-12)
    columns = np.stack([(inputs - centre) / spread, np.ones(len(inputs))], 1)
    start, nearness = np.zeros(2), 0.0
    if near is not None:
        start = np.array([near.slope * spread, near.offset + near.slope * centre])
        nearness = NEARNESS
    fit = _logistic_regression(columns, target, weight, start, nearness)
    slope = float(fit[0] / spread)
    if slope <= 0:  # probability must not fall with the score
        share = float((weight * target).sum() / weight.sum())
        return PlattCurve(0.0, float(np.log(share / (1 - share))))
    return PlattCurve(slope, float(fit[1] - fit[0] * centre / spread))


def _logistic_regression(
    inputs: np.ndarray, target: np.ndarray, weight: np.ndarray, start: np.ndarray, nearness: float
) -> np.ndarray:
    """Coefficients, (2,), for inputs (N, 2), by Newton's method;
    a step is halved until the loss does not rise.

    ``nearness``: weight of half the squared distance from the ``start``, (2,).
    """

    def loss_of(coefficients: np.ndarray) -> float:
        score, moved = inputs @ coefficients, coefficients - start
        loss = (weight * (np.logaddexp(0, score) - target * score)).sum()
        return float(loss + nearness / 2 * moved @ moved)

    coefficients = start.copy()
    loss = loss_of(coefficients)
    for _ in range(STEPS):
        likely = _sigmoid(inputs @ coefficients)
        gradient = inputs.T @ (weight * (likely - target)) + nearness * (coefficients - start)
        hessian = (inputs * (weight * likely * (1 - likely))[:, None]).T @ inputs
        hessian = hessian + (1e-9 + nearness) * np.eye(2)
        step, share = np.linalg.solve(hessian, gradient), 1.0
        while (after := loss_of(coefficients - share * step)) > loss and share > GAIN:
            share /= 2
        coefficients, gain, loss = coefficients - share * step, loss - after, after
        if gain <= GAIN * abs(loss):
            break
    return coefficients


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-np.logaddexp(0, -values)))
