"""TransE with the norm of city blocks, which PyKEEN, TorchKGE and OpenKE have by default or on demand."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from isi.config import Positive
from isi.models.model import Model


@dataclass(frozen=True)
class TransEL1(Model):
    """f(h, r, t) = margin - ‖vₕ + r - vₜ‖₁."""

    margin: Positive

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return self.margin - (head + relation - tail).abs().sum(-1)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v + r."""
        return vectors + relation

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v - r."""
        return vectors - relation
