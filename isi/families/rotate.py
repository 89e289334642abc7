"""RotatE (Sun et al. 2019): a relation turns each pair of coordinates by a phase."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from isi.base.params import Positive
from isi.embeddings import bits
from isi.embeddings.blocks import Blocks
from isi.embeddings.meeting import Distance, Meeting
from isi.families import family


@family("rotate")
@dataclass(frozen=True)
class RotatE(Blocks):
    """f(h, r, t) = margin - ‖vₕᵀW - vₜ‖, or less its square, where W has blocks of x = cos θ, y = sin θ.

    A relation's row holds the phases θ.
    """

    scalars = 0
    margin: Positive
    squared: bool

    @property
    def meeting(self) -> Meeting:
        return Distance(self.margin, self.squared)

    def width(self, dimension: int) -> int:
        return super().width(dimension) // 2

    def half_range(self, given: float) -> float:  # noqa: ARG002
        """All around."""
        return math.pi

    def maps(self, relation: Tensor) -> Tensor:
        return torch.cat([bits.padded(torch.cos, relation), bits.padded(torch.sin, relation)], -1)

    def pull_maps(self, by_maps: Tensor, relation: Tensor) -> Tensor:
        """By θ: cos θ times that by y, less sin θ times that by x."""
        (x, y), (by_x, by_y) = self.maps(relation).chunk(2, -1), by_maps.chunk(2, -1)
        return x * by_y - y * by_x
