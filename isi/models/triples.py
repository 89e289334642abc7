"""Which triples of a stack are scored: all, as dense tables, or a list.

A formula written once holds for both forms: it gathers rows of tables with ``heads`` and
``relations``, and sums gradients with ``by_head`` and ``by_relation``. Below, ``...`` stands for
(M, R, E), the heads under each relation, in dense tables, and for (N,) in a list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from torch import Tensor

from isi.models import bits
from isi.models.interaction import Backward, Interaction

Linear = Callable[[Tensor], Tensor]
#: Takes the vectors of heads, relations and tails, which broadcast against each other, from a model's two tables.
Pick = Callable[[Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]


@dataclass(frozen=True)
class DenseTriples:
    """All triples of M models; their scores are tables by relation, head and tail, (M, R, E, E)."""

    #: M, R and E
    shape: tuple[int, int, int]

    @classmethod
    def of(cls, entity: Tensor, relation: Tensor) -> DenseTriples:
        """All triples of tables of shape (M, E, d) and (M, R, w)."""
        return cls((len(entity), relation.shape[1], entity.shape[1]))

    def heads(self, table: Tensor) -> Tensor:
        """Rows of heads from a table, (M, E, d), as they broadcast to (..., d)."""
        return table[:, None]

    def relations(self, table: Tensor) -> Tensor:
        """Rows of relations from a table, (M, R, d), as they broadcast to (..., d)."""
        return table[:, :, None]

    def empty_mapped(self, entity: Tensor) -> tuple[Tensor, Tensor]:
        """Memory for mapped heads: as ``interact`` takes it, and as a view of shape (..., d)."""
        memory = self._spaced(entity, entity.shape[-1])
        return memory, memory[:, :-1].view(*self.shape, -1)

    def empty_scores(self, entity: Tensor) -> Tensor:
        """Memory for scores."""
        return self._spaced(entity, self.shape[2])[:, :-1].view(*self.shape, -1)

    def by_head(self, values: Tensor, swapped: tuple[Tensor, Linear] | None = None) -> Tensor:
        """Sums by head of values, (..., d), and of other values under a linear function; shape (M, E, d).

        ``values`` may be overwritten.
        """
        total = values.sum(1)
        if swapped:
            others, linear = swapped
            total = total + linear(others.sum(1))  # of the sums, since they are fewer
        return total

    def by_relation(self, values: Tensor) -> Tensor:
        """Sums by relation of values of shape (..., d); shape (M, R, d)."""
        return values.sum(2)

    def interact(self, interaction: Interaction, mapped: Tensor, entity: Tensor) -> tuple[Tensor, Backward]:
        """Scores of mapped heads with their tails, and gradients by mapped heads, (..., d), and by entities."""
        scores, by_pairs = interaction.pairs(mapped, entity)

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = by_pairs(slope.view(len(slope), -1, slope.shape[-1]))
            return by_mapped.view(*self.shape, -1), by_tail

        return scores[:, :-1].view(*self.shape, -1), backward

    def parts(self) -> Iterator[tuple[int, Any, Pick]]:
        """The triples in parts of one model each, for formulas that know no stack.

        Yields:
            place in the stack; place in scores and among mapped heads; and what picks the vectors.
        """
        for model in range(self.shape[0]):
            for number in range(self.shape[1]):
                yield model, (model, number), partial(self._pick, number)

    @staticmethod
    def _pick(number: int, entity: Tensor, relation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return entity[:, None], relation[number], entity[None]

    def _spaced(self, like: Tensor, width: int) -> Tensor:
        models, relations, entities = self.shape
        return bits.empty(like, models, relations * entities, width)


@dataclass(frozen=True)
class TripleList:
    """A list of N triples of the models of a stack; its methods are those of ``DenseTriples``."""

    #: M, R and E
    shape: tuple[int, int, int]
    #: place in the stack, and ids; shapes: (N,), int64
    model: Tensor
    head: Tensor
    relation: Tensor
    tail: Tensor

    def heads(self, table: Tensor) -> Tensor:
        return self._gather(table, self.head)

    def relations(self, table: Tensor) -> Tensor:
        return self._gather(table, self.relation)

    def empty_mapped(self, entity: Tensor) -> tuple[Tensor, Tensor]:
        memory = entity.new_empty(len(self.model), entity.shape[-1])
        return memory, memory

    def empty_scores(self, entity: Tensor) -> Tensor:
        return entity.new_empty(len(self.model))

    def by_head(self, values: Tensor, swapped: tuple[Tensor, Linear] | None = None) -> Tensor:
        if swapped:
            others, linear = swapped
            values = values.add_(linear(others))  # first, since a sum by ids takes most of the time
        return self._sum(values, self.head, self.shape[2])

    def by_relation(self, values: Tensor) -> Tensor:
        return self._sum(values, self.relation, self.shape[1])

    def interact(self, interaction: Interaction, mapped: Tensor, entity: Tensor) -> tuple[Tensor, Backward]:
        scores, by_rows = interaction.rows(mapped, self._gather(entity, self.tail))

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = by_rows(slope)
            return by_mapped, self._sum(by_tail, self.tail, self.shape[2])

        return scores, backward

    def parts(self) -> Iterator[tuple[int, Any, Pick]]:
        for model in range(self.shape[0]):
            place = (self.model == model).nonzero()[:, 0]
            yield model, place, partial(self._pick, place)

    def _pick(self, place: Tensor, entity: Tensor, relation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return entity[self.head[place]], relation[self.relation[place]], entity[self.tail[place]]

    def _gather(self, table: Tensor, ids: Tensor) -> Tensor:
        """Rows of a stack of tables, (M, N', d), one for each triple; shape (N, d)."""
        return table.flatten(0, 1).index_select(0, self.model * table.shape[1] + ids)

    def _sum(self, values: Tensor, ids: Tensor, number: int) -> Tensor:
        """Sums by model and id of values of shape (N, d); shape (M, number, d)."""
        table = values.new_zeros(self.shape[0] * number, values.shape[-1])
        return table.index_add_(0, self.model * number + ids, values).view(self.shape[0], number, -1)


Triples = DenseTriples | TripleList
