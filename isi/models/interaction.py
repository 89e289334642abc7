"""How a mapped head and a tail make a score, with its gradient: a product or a distance.

Each interaction has two forms: of rows, pair by pair, and of all pairs of two tables, which is one
matrix product (and two norms for a distance).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

#: Smallest squared distance: below it rounding decides, and a gradient that divides by the distance would be noise.
EPSILON = 1e-6

#: From the slope of each score to the gradients of Σ slope · f by two tables.
Backward = Callable[[Tensor], tuple[Tensor, Tensor]]


class Interaction(Protocol):
    """Scores f(m, t) of mapped heads m and tails t."""

    def score(self, mapped: Tensor, tail: Tensor) -> Tensor:
        """Scores of pairs; shapes (..., d), broadcast against each other, result (...)."""

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        """Scores of pairs, and gradients by mapped heads and tails; shapes (N, d), scores (N,)."""

    def pairs(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        """The same of all pairs; shapes (M, N, d) and (M, E, d), scores (M, N, E).

        Slopes may be of the first mapped heads alone, (M, n, E).
        """


@dataclass(frozen=True)
class Product:
    """f = ⟨m, t⟩."""

    def score(self, mapped: Tensor, tail: Tensor) -> Tensor:
        return (mapped * tail).sum(-1)

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        return self.score(mapped, tail), lambda slope: (tail * slope[:, None], mapped * slope[:, None])

    def pairs(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            return torch.bmm(slope, tail), torch.bmm(slope.mT, mapped[:, : slope.shape[1]])

        return torch.bmm(mapped, tail.mT), backward


@dataclass(frozen=True)
class Distance:
    """f = margin - ‖m - t‖, or margin - ‖m - t‖² where ``squared``; squares are clamped to ``EPSILON``.

    Of all pairs, ‖m - t‖² = ‖m‖² + ‖t‖² - 2⟨m, t⟩. With c = 1 / ‖m - t‖ (or 2, where squared) the
    gradient by m is c · (t - m), and the opposite by t.
    """

    margin: float
    squared: bool

    def score(self, mapped: Tensor, tail: Tensor) -> Tensor:
        return self.margin - self._distance((mapped - tail).square().sum(-1))

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        gap = tail - mapped
        distance = self._distance(gap.square().sum(-1))

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped = gap * self._times_c(slope, distance)[:, None]
            return by_mapped, -by_mapped

        return self.margin - distance, backward

    def pairs(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        square = mapped.square().sum(-1)[:, :, None] + tail.square().sum(-1)[:, None]
        distance = self._distance(square.baddbmm_(mapped, tail.mT, alpha=-2))

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            first = mapped[:, : slope.shape[1]]
            weight = self._times_c(slope, distance[:, : slope.shape[1]])
            by_mapped = torch.bmm(weight, tail).sub_(first * weight.sum(2)[..., None])
            return by_mapped, torch.bmm(weight.mT, first).sub_(tail * weight.sum(1)[..., None])

        return self.margin - distance, backward

    def _distance(self, square: Tensor) -> Tensor:
        square = square.clamp_(min=EPSILON)
        return square if self.squared else square.sqrt_()

    def _times_c(self, slope: Tensor, distance: Tensor) -> Tensor:
        return 2 * slope if self.squared else slope / distance
