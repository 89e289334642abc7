"""TransE (Bordes et al. 2013): a relation is a step from head to tail.

RotatE (Sun et al. 2019): a relation turns each pair of coordinates by a phase.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from isi.config import Positive
from isi.models import bits
from isi.models.bilinear import Blocks
from isi.models.interaction import Backward, Distance, Interaction
from isi.models.model import RelationMapModel, register_model
from isi.models.triples import Triples


@register_model("transe")
@dataclass(frozen=True)
class TransE(RelationMapModel):
    """f(h, r, t) = margin - ‖vₕ + r - vₜ‖, or less its square."""

    margin: Positive
    squared: bool

    @property
    def interaction(self) -> Interaction:
        return Distance(self.margin, self.squared)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v + r."""
        return vectors + relation

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v - r."""
        return vectors - relation

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.inverse(vectors, relation)

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        rows, mapped = triples.room(entity)
        torch.add(triples.heads(entity), triples.relations(relation), out=mapped)
        return rows, lambda pulled: (triples.by_head(pulled), triples.by_relation(pulled))


@register_model("rotate")
@dataclass(frozen=True)
class RotatE(Blocks):
    """f(h, r, t) = margin - ‖vₕᵀW - vₜ‖, or less its square, where W has blocks of x = cos θ, y = sin θ.

    A relation's row holds the phases θ.
    """

    scalars = 0
    margin: Positive
    squared: bool

    @property
    def interaction(self) -> Interaction:
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
