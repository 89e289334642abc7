"""Models that score by a distance: TransE (Bordes et al. 2013), with L1 or L2 norm,
and RotatE (Sun et al. 2019).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.config import Positive
from isi.models.bilinear import BlockModel
from isi.models.model import ConstrainedModel, Model, register_model
from isi.models.scoring import Backward, Distance, Interaction, L1Distance, Triples, padded


class Translation(Model):
    """Relations that translate a head: h + r."""

    distance = True

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors + relation

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors - relation


@dataclass(frozen=True)
class DistanceModel(ConstrainedModel):
    """f(h, r, t) = margin - ‖transform(h, r) - vₜ‖, or with ‖·‖² if ``squared``."""

    distance = True
    margin: Positive
    squared: bool = False

    @property
    def interaction(self) -> Interaction:
        return Distance(self.margin, self.squared)


@register_model("transe", defaults={"margin": 2.0, "squared": True})
@dataclass(frozen=True)
class TransE(Translation, DistanceModel):
    """f(h, r, t) = margin - ‖vₕ + r - vₜ‖, or with ‖·‖² if ``squared``."""

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        memory, mapped = triples.empty(entity, entity.shape[-1])
        torch.add(triples.heads(entity), triples.relations(relation), out=mapped)
        return memory, lambda by_mapped: (
            triples.by_head(by_mapped),
            triples.by_relation(by_mapped),
        )


@register_model("transe_l1", defaults={"margin": 8.0})
@dataclass(frozen=True)
class TransEL1(Translation, ConstrainedModel):
    """f(h, r, t) = margin - ‖vₕ + r - vₜ‖₁, the default TransE of PyKEEN and OpenKE."""

    margin: Positive

    @property
    def interaction(self) -> Interaction:
        return L1Distance(self.margin)


@register_model("rotate", defaults={"margin": 4.0, "squared": True})
@dataclass(frozen=True)
class RotatE(DistanceModel, BlockModel):
    """f(h, r, t) = margin - ‖vₕᵀW - vₜ‖, or ‖·‖² if ``squared``; blocks have x = cos θ, y = sin θ;
    relation row θ.
    """

    complex_vectors = True
    angles = True
    scalars = 0

    def width(self, dimension: int) -> int:
        return super().width(dimension) // 2

    def maps(self, relation: Tensor) -> Tensor:
        return torch.cat([padded(torch.cos, relation), padded(torch.sin, relation)], -1)

    def maps_backward(self, by_maps: Tensor, relation: Tensor) -> Tensor:
        """Gradient by θ, (M, R, w): with x = cos θ and y = sin θ it is x · ∂f/∂y - y · ∂f/∂x."""
        (x, y), (by_x, by_y) = self.maps(relation).chunk(2, -1), by_maps.chunk(2, -1)
        return x * by_y - y * by_x
