"""Scores of triples by the vector of a novel entity, and their slopes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from isi.models.model import Model, RelationMapModel
from isi.models.scoring import Interaction


class Score(Protocol):
    """The score f of each of C triples by vectors v, (B, d), float32."""

    def scores(self, at: Tensor) -> Tensor:
        """f; shape (B, C)."""

    def slopes(self, at: Tensor) -> Tensor:
        """∂f/∂v; shape (B, C, d)."""


@dataclass(frozen=True)
class LinearScore:
    """f = ⟨v, α⟩; ``alpha``: (B, C, d)."""

    alpha: Tensor

    def scores(self, at: Tensor) -> Tensor:
        return (self.alpha @ at[..., None])[..., 0]

    def slopes(self, at: Tensor) -> Tensor:  # noqa: ARG002
        return self.alpha


@dataclass(frozen=True)
class MappedScore:
    """f = interaction(α, v), where α is the known end, mapped by the relation;
    ``alpha``: (B, C, d).
    """

    interaction: Interaction
    alpha: Tensor

    def scores(self, at: Tensor) -> Tensor:
        return self.interaction.rows(self.alpha, at[:, None])[0]

    def slopes(self, at: Tensor) -> Tensor:
        score, backward = self.interaction.rows(self.alpha, at[:, None])
        return backward(torch.ones_like(score))[1]


@dataclass(frozen=True)
class AnyScore:
    """f of vectors for each triple, (B, C, d), with slopes by autograd."""

    function: Callable[[Tensor], Tensor]
    triples: int  #: C

    def scores(self, at: Tensor) -> Tensor:
        return self.function(self._for_each(at))

    def slopes(self, at: Tensor) -> Tensor:
        with torch.enable_grad():
            vectors = self._for_each(at).clone().requires_grad_()
            total = self.function(vectors).sum()
        return torch.autograd.grad(total, vectors)[0]

    def _for_each(self, at: Tensor) -> Tensor:
        return at[:, None].expand(-1, self.triples, -1)


def score_of(model: Model, is_tail: Tensor, relation: Tensor, other: Tensor) -> Score:
    """f of triples by vectors of the novel entities; shapes (B, C, 1), (B, C, w), (B, C, d)."""
    if model.linear:
        return LinearScore(anchors(model, is_tail, relation, other))
    if isinstance(model, RelationMapModel):
        return MappedScore(model.interaction, anchors(model, is_tail, relation, other))

    def score(novel: Tensor) -> Tensor:
        return model.score(
            torch.where(is_tail, other, novel), relation, torch.where(is_tail, novel, other)
        )

    return AnyScore(score, other.shape[1])


def anchors(model: Model, is_tail: Tensor, relation: Tensor, other: Tensor) -> Tensor:
    """α of triples, (B, C, d): their known ends, mapped by the relation;
    shapes as in ``score_of``.
    """
    alpha, at = torch.empty_like(other), is_tail[..., 0]
    alpha[at] = model.transform(other[at], relation[at])
    alpha[~at] = model.transform_tail(other[~at], relation[~at])
    return alpha
