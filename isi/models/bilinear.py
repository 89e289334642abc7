"""Models whose relations are linear maps of scalars and 2×2 blocks: ANALOGY, DistMult and ComplEx.

The d coordinates of a vector are its scalars, then the first coordinates a of all blocks, then
their second coordinates b. A relation's row has a factor r for each scalar and, at the places of a
and b, the entries x and y of each block ``[[x, y], [-y, x]]`` of W. With ``swap`` exchanging a and
b,

    vᵀW = v ⊙ (r, x, x) + swap(v) ⊙ (0, -y, y)

so that a map takes two elementwise products.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from isi.errors import InputError
from isi.models.model import ConstrainedModel, register_model
from isi.models.scoring import Backward, Triples
from isi.tables import paths

CLAMP = 1e-6  #: Lower bound of the |r| and x² + y² by which ``inverse`` divides.


class BlockModel(ConstrainedModel):
    """f(h, r, t) = interaction(vₕᵀW, vₜ), W block-diagonal (scalars, 2×2 blocks);
    by default ⟨vₕᵀW, vₜ⟩.
    """

    scalars: ClassVar[int]  #: percentage of coordinates that are scalars

    @classmethod
    def is_plain(cls) -> bool:
        """Whether f = ⟨vₕᵀW, vₜ⟩, with W's entries as rows of relations: no method is replaced."""
        methods = ("interaction", "maps", "score", "transform", "transform_tail")
        return all(getattr(cls, name) is getattr(BlockModel, name) for name in methods)

    def width(self, dimension: int) -> int:
        multiple = next(
            m
            for m in range(1, 201)
            if m * self.scalars % 100 == 0 == m * (100 - self.scalars) % 200
        )
        if dimension % multiple:
            expected = f"expected a multiple of {multiple}, as {type(self).__name__} needs"
            raise InputError(paths.PARAMS, f"dimension {dimension}", expected)
        return dimension

    def maps(self, relation: Tensor) -> Tensor:
        """Entries (r, x, y) of W, (..., d), from rows of relations, (..., w)."""
        return relation

    def maps_backward(self, by_maps: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        """Gradient with respect to relations, (..., w),
        from that with respect to their ``maps``, (..., d).
        """
        return by_maps

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """vᵀW."""
        return self._apply(self.maps(relation), vectors)

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Wv = vᵀWᵀ: the y of each block changes its sign."""
        scalars, x, y = self.parts(self.maps(relation))
        return self._apply(torch.cat([scalars, x, -y], -1), vectors)

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """vᵀW⁻¹, with |r| and x² + y² clamped to at least ``CLAMP``."""
        scalars, x, y = self.parts(self.maps(relation))
        sign = torch.where(scalars < 0, -1.0, 1.0)
        norm = (x * x + y * y).clamp(min=CLAMP)
        return self._apply(
            torch.cat([sign / scalars.abs().clamp(min=CLAMP), x / norm, -y / norm], -1), vectors
        )

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        straight, crossed = (
            triples.relations(factor) for factor in self._factors(self.maps(relation))
        )
        heads, swapped = triples.heads(entity), triples.heads(self._swap(entity))
        memory, mapped = triples.empty(entity, entity.shape[-1])
        torch.mul(heads, straight, out=mapped).addcmul_(swapped, crossed)

        def backward(by_mapped: Tensor) -> tuple[Tensor, Tensor]:
            by_entity = triples.by_head(by_mapped * straight, (by_mapped * crossed, self._swap))
            scalars, straight_a, straight_b = self.parts(triples.by_relation(by_mapped * heads))
            _, crossed_a, crossed_b = self.parts(triples.by_relation(by_mapped * swapped))
            by_maps = torch.cat([scalars, straight_a + straight_b, crossed_b - crossed_a], -1)
            return by_entity, self.maps_backward(by_maps, relation)

        return memory, backward

    def parts(self, vectors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Split vectors, (..., d), into scalars, a and b, or maps, (..., d), into r, x and y."""
        first = vectors.shape[-1] * self.scalars // 100
        middle = (first + vectors.shape[-1]) // 2
        return vectors[..., :first], vectors[..., first:middle], vectors[..., middle:]

    def _apply(self, maps: Tensor, vectors: Tensor) -> Tensor:
        straight, crossed = self._factors(maps)
        return torch.addcmul(vectors * straight, self._swap(vectors), crossed)

    def _swap(self, vectors: Tensor) -> Tensor:
        scalars, a, b = self.parts(vectors)
        return torch.cat([scalars, b, a], -1)

    def _factors(self, maps: Tensor) -> tuple[Tensor, Tensor]:
        """(r, x, x) and (0, -y, y) of (r, x, y); shapes (..., d)."""
        scalars, x, y = self.parts(maps)
        return torch.cat([scalars, x, x], -1), torch.cat([torch.zeros_like(scalars), -y, y], -1)


@register_model("analogy")
@dataclass(frozen=True)
class ANALOGY(BlockModel):
    """f(h, r, t) = ⟨vₕᵀW, vₜ⟩: half of the coordinates are scalars,
    half belong to blocks (Liu et al. 2017).
    """

    linear = True
    scalars = 50


@register_model("complex")
@dataclass(frozen=True)
class ComplEx(BlockModel):
    """f(h, r, t) = Re⟨vₕ ⊙ r, conj(vₜ)⟩: all coordinates belong to
    blocks (Trouillon et al. 2016).
    """

    linear = True
    complex_vectors = True
    scalars = 0


@register_model("distmult")
@dataclass(frozen=True)
class DistMult(BlockModel):
    """f(h, r, t) = ⟨vₕ ⊙ r, vₜ⟩: a triple and its reverse score alike (Yang et al. 2015)."""

    linear = True
    scalars = 100
