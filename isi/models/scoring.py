"""Scores of triples by product or distance, and their gradients:
for all triples (dense), or for a list.

The formula of a model is the same for both forms: it reads rows of tables with ``heads`` and
``relations``, and sums gradients with ``by_head`` and ``by_relation``. In shapes below, ``...`` is
(M, R, E), each relation with each head, for ``DenseTriples``, and (N,) for ``TripleList``.

Scores and gradients of both forms are bit-identical for any number of models in the stack. PyTorch
processes an array register by register, and rounds the last numbers differently if they do not fill
a register. So a dense table has a spare row in memory behind each model (``spaced``), which makes
PyTorch process each model by itself, and a list is padded (``padded``).

That does not hold for ``Model.score_tails`` and ``score_heads``, which rank. Their matrix products
may differ in the last bits with the number of models or queries, above all with a single entity, or
with rows whose length is no multiple of 4. Ranks stay the same unless a difference of scores lies
at the edge of the tolerance ``isi.evaluation.ranks.TIE``, within which they are tied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

EPSILON = 1e-6  #: Smallest squared distance: a gradient that divides by less would be noise.
_REGISTER = 64  #: A multiple of the number of floats in a register of any processor.

#: Maps slopes to both gradients of Σ slope · f.
Backward = Callable[[Tensor], tuple[Tensor, Tensor]]
Linear = Callable[[Tensor], Tensor]
#: Indices of heads, relations and tails into a model's tables; the indexed vectors broadcast
#: against each other.
Indices = tuple[Any, Any, Any]


def spaced(table: Tensor) -> Tensor:
    """A copy of a stack of tables with a spare row in memory behind each model; shape (M, N, d)."""
    models, rows, width = table.shape
    return table.new_zeros(models, rows + 1, width)[:, :-1].copy_(table)


def padded(function: Callable[[Tensor], Tensor], values: Tensor) -> Tensor:
    """Apply an elementwise function, any shape;
    a result's bits do not depend on the number's place in the tensor.
    """
    flat = values.flatten()
    return function(pad(flat, (0, -len(flat) % _REGISTER)))[: len(flat)].view(values.shape)


@dataclass(frozen=True)
class Product:
    """f(m, t) = ⟨m, t⟩ of mapped heads m and tails t."""

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        """Scores, (...), of mapped heads and tails, (..., d), which broadcast;
        a function from slopes to gradients.
        """
        return (mapped * tail).sum(-1), lambda slope: (
            tail * slope[..., None],
            mapped * slope[..., None],
        )

    def pairs(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        """As ``rows``, of all pairs: (M, N, d), (M, E, d); scores (M, N, E);
        slopes may lack last rows: (M, ≤N, E).
        """

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            return torch.bmm(slope, tail), torch.bmm(slope.mT, mapped[:, : slope.shape[1]])

        return torch.bmm(mapped, tail.mT), backward


@dataclass(frozen=True)
class Distance:
    """f(m, t) = margin - ‖m - t‖, or margin - ‖m - t‖² if ``squared``;
    ‖m - t‖² is at least ``EPSILON``.

    For all pairs, ‖m - t‖² = ‖m‖² + ‖t‖² - 2⟨m, t⟩. The gradient by m is c · (t - m), by t its
    negative, with c = 1 / ‖m - t‖, or c = 2 if ``squared``.
    """

    margin: float
    squared: bool

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        gap = tail - mapped
        distance = self._distance(gap.square().sum(-1))

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped = gap * self._times_c(slope, distance)[..., None]
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


@dataclass(frozen=True)
class L1Distance:
    """f(m, t) = margin - ‖m - t‖₁, the sum of absolute differences."""

    margin: float

    def rows(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        gap = tail - mapped

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped = gap.sign() * slope[..., None]
            return by_mapped, -by_mapped

        return self.margin - gap.abs().sum(-1), backward

    def pairs(self, mapped: Tensor, tail: Tensor) -> tuple[Tensor, Backward]:
        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            tables = (
                mapped[:, : slope.shape[1]].detach().requires_grad_(),
                tail.detach().requires_grad_(),
            )
            with torch.enable_grad():
                distance = torch.cdist(*tables, p=1)
            by_mapped, by_tail = torch.autograd.grad(distance, tables, -slope)
            return by_mapped, by_tail

        return self.margin - torch.cdist(mapped, tail, p=1), backward


Interaction = Product | Distance | L1Distance


@dataclass(frozen=True)
class DenseTriples:
    """All triples of M models; their scores have the shape (M, R, E, E): relation, head, tail."""

    shape: tuple[int, int, int]  #: M, R and E

    @classmethod
    def of(cls, entity: Tensor, relation: Tensor) -> DenseTriples:
        """All triples over tables of shapes (M, E, d) and (M, R, w)."""
        return cls((len(entity), relation.shape[1], entity.shape[1]))

    def heads(self, table: Tensor) -> Tensor:
        """The heads' rows of a table, (M, E, d), in a shape that broadcasts to (..., d)."""
        return table[:, None]

    def relations(self, table: Tensor) -> Tensor:
        """The relations' rows of a table, (M, R, d), in a shape that broadcasts to (..., d)."""
        return table[:, :, None]

    def empty(self, entity: Tensor, width: int | None = None) -> tuple[Tensor, Tensor]:
        """Memory for ``interact``, and its view as mapped heads, (..., width);
        without ``width``, as scores.
        """
        models, relations, entities = self.shape
        memory = entity.new_zeros(models, relations * entities + 1, width or entities)
        return memory, memory[:, :-1].view(*self.shape, -1)

    def by_head(self, values: Tensor, swapped: tuple[Tensor, Linear] | None = None) -> Tensor:
        """Sum values, (..., d), plus f(x) if ``swapped`` is (x, f), f linear, by head; (M, E, d);
        may alter values.
        """
        total = values.sum(1)
        # f of the sums, which are fewer
        return total + swapped[1](swapped[0].sum(1)) if swapped else total

    def by_relation(self, values: Tensor) -> Tensor:
        """Sum values, (..., d), by relation; shape (M, R, d)."""
        return values.sum(2)

    def interact(
        self, interaction: Interaction, mapped: Tensor, entity: Tensor
    ) -> tuple[Tensor, Backward]:
        """Scores of mapped heads and tails; and a function from slopes to gradients by
        mapped heads and by entities.
        """
        scores, by_pairs = interaction.pairs(mapped, entity)

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = by_pairs(slope.view(len(slope), -1, slope.shape[-1]))
            return by_mapped.view(*self.shape, -1), by_tail

        return scores[:, :-1].view(*self.shape, -1), backward

    def parts(self) -> Iterator[tuple[int, Any, Indices]]:
        """Parts of the scores, each of one model: its place in the stack, index of scores,
        indices of table rows.
        """
        for model, number in product(range(self.shape[0]), range(self.shape[1])):
            yield model, (model, number), ((slice(None), None), number, None)


@dataclass(frozen=True)
class TripleList:
    """N triples, each of one model of a stack; ``DenseTriples`` documents the methods."""

    shape: tuple[int, int, int]  #: M, R and E
    model: Tensor  #: place in the stack; shape: (N,), int64, as for the three ids
    head: Tensor
    relation: Tensor
    tail: Tensor

    def heads(self, table: Tensor) -> Tensor:
        return self._gather(table, self.head)

    def relations(self, table: Tensor) -> Tensor:
        return self._gather(table, self.relation)

    def empty(self, entity: Tensor, width: int | None = None) -> tuple[Tensor, Tensor]:
        memory = entity.new_empty((len(self.model), width) if width else len(self.model))
        return memory, memory

    def by_head(self, values: Tensor, swapped: tuple[Tensor, Linear] | None = None) -> Tensor:
        if swapped:  # added first, since a sum by ids takes most of the time
            values = values.add_(swapped[1](swapped[0]))
        return self._sum(values, self.head, self.shape[2])

    def by_relation(self, values: Tensor) -> Tensor:
        return self._sum(values, self.relation, self.shape[1])

    def interact(
        self, interaction: Interaction, mapped: Tensor, entity: Tensor
    ) -> tuple[Tensor, Backward]:
        scores, by_rows = interaction.rows(mapped, self._gather(entity, self.tail))

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = by_rows(slope)
            return by_mapped, self._sum(by_tail, self.tail, self.shape[2])

        return scores, backward

    def parts(self) -> Iterator[tuple[int, Any, Indices]]:
        for model in range(self.shape[0]):
            place = (self.model == model).nonzero()[:, 0]
            yield model, place, (self.head[place], self.relation[place], self.tail[place])

    def _gather(self, table: Tensor, ids: Tensor) -> Tensor:
        """The row of each triple's model and id in a stack of tables, (M, N', d); shape (N, d)."""
        return table.flatten(0, 1).index_select(0, self.model * table.shape[1] + ids)

    def _sum(self, values: Tensor, ids: Tensor, number: int) -> Tensor:
        """Sum values, (N, d), by model and id; shape (M, number, d)."""
        table = values.new_zeros(self.shape[0] * number, values.shape[-1])
        return table.index_add_(0, self.model * number + ids, values).view(
            self.shape[0], number, -1
        )


Triples = DenseTriples | TripleList
