"""TransE (Bordes et al. 2013): a relation is a step from head to tail."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.base.params import Positive
from isi.embeddings.family import Mapping
from isi.embeddings.meeting import Distance, Meeting, Pull
from isi.embeddings.triples import Triples
from isi.families import family


@family("transe")
@dataclass(frozen=True)
class TransE(Mapping):
    """f(h, r, t) = margin - ‖vₕ + r - vₜ‖, or less its square."""

    margin: Positive
    squared: bool

    @property
    def meeting(self) -> Meeting:
        return Distance(self.margin, self.squared)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v + r."""
        return vectors + relation

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """v - r."""
        return vectors - relation

    def pullback(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.inverse(vectors, relation)

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Pull]:
        rows, mapped = triples.room(entity)
        torch.add(triples.heads(entity), triples.relations(relation), out=mapped)
        return rows, lambda pulled: (triples.by_head(pulled), triples.by_relation(pulled))
