"""Which triples of a stack are scored: all, as tables, or some, as a list.

A formula written for one holds for both: it takes what triples need of a table with ``heads`` and
``relations``, and sums what they give back with ``by_head`` and ``by_relation``. Below, ``...`` are
(M, R, E), the heads under each relation, in tables, and (N,) in a list.
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
        """What the heads take of a table, (M, E, d), as it broadcasts to (..., d)."""
        return table[:, None]

    def relations(self, table: Tensor) -> Tensor:
        """What the relations take of a table, (M, R, d), as it broadcasts to (..., d)."""
        return table[:, :, None]

    def room(self, entity: Tensor) -> tuple[Tensor, Tensor]:
        """Place for mapped heads: as ``meet`` takes it, and as a view of shape (..., d)."""
        rows = self._apart(entity, entity.shape[-1])
        return rows, rows[:, :-1].view(*self.shape, -1)

    def by_head(self, plain: Tensor, crossed: tuple[Tensor, Linear] | None = None) -> Tensor:
        """Sums by head of values of shape (..., d), and of others of which a linear function is taken; shape (M, E, d).

        ``plain`` may be overwritten.
        """
        total = plain.sum(1)
        if crossed:
            values, turn = crossed
            total = total + turn(values.sum(1))  # of the sums, since they are fewer
        return total

    def by_relation(self, values: Tensor) -> Tensor:
        """Sums by relation of values of shape (..., d); shape (M, R, d)."""
        return values.sum(2)

    def meet(self, meeting: Interaction, rows: Tensor, entity: Tensor) -> tuple[Tensor, Backward]:
        """Scores of mapped heads with their tails, and how slopes pull at mapped heads, (..., d), and at entities."""
        scores, pull_pairs = meeting.pairs(rows, entity)

        def pull(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = pull_pairs(slope.view(len(slope), -1, slope.shape[-1]))
            return by_mapped.view(*self.shape, -1), by_tail

        return scores[:, :-1].view(*self.shape, -1), pull

    def empty_scores(self, entity: Tensor) -> Tensor:
        """Place for scores."""
        return self._apart(entity, self.shape[2])[:, :-1].view(*self.shape, -1)

    def one_by_one(self) -> Iterator[tuple[int, Any, Pick]]:
        """The triples in parts of one model each, for what is not written for a stack.

        Yields:
            place in the stack; place in scores and among mapped heads; and what picks the vectors.
        """
        for model in range(self.shape[0]):
            for number in range(self.shape[1]):
                yield model, (model, number), partial(self._pick, number)

    @staticmethod
    def _pick(number: int, entity: Tensor, relation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return entity[:, None], relation[number], entity[None]

    def _apart(self, like: Tensor, width: int) -> Tensor:
        models, relations, entities = self.shape
        return bits.room(like, models, relations * entities, width)


@dataclass(frozen=True)
class TripleList:
    """A list of N triples of the models of a stack; see ``Every`` for what its methods give."""

    #: M, R and E
    shape: tuple[int, int, int]
    #: place in the stack, and ids; shapes: (N,), int64
    model: Tensor
    head: Tensor
    relation: Tensor
    tail: Tensor

    def heads(self, table: Tensor) -> Tensor:
        return self._gathered(table, self.head)

    def relations(self, table: Tensor) -> Tensor:
        return self._gathered(table, self.relation)

    def room(self, entity: Tensor) -> tuple[Tensor, Tensor]:
        rows = entity.new_empty(len(self.model), entity.shape[-1])
        return rows, rows

    def by_head(self, plain: Tensor, crossed: tuple[Tensor, Linear] | None = None) -> Tensor:
        if crossed:
            values, turn = crossed
            plain = plain.add_(turn(values))  # first, since a sum by ids is what takes time
        return self._summed(plain, self.head, self.shape[2])

    def by_relation(self, values: Tensor) -> Tensor:
        return self._summed(values, self.relation, self.shape[1])

    def meet(self, meeting: Interaction, rows: Tensor, entity: Tensor) -> tuple[Tensor, Backward]:
        scores, pull_rows = meeting.rows(rows, self._gathered(entity, self.tail))

        def pull(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = pull_rows(slope)
            return by_mapped, self._summed(by_tail, self.tail, self.shape[2])

        return scores, pull

    def empty_scores(self, entity: Tensor) -> Tensor:
        return entity.new_empty(len(self.model))

    def one_by_one(self) -> Iterator[tuple[int, Any, Pick]]:
        for model in range(self.shape[0]):
            place = (self.model == model).nonzero()[:, 0]
            yield model, place, partial(self._pick, place)

    def _pick(self, place: Tensor, entity: Tensor, relation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return entity[self.head[place]], relation[self.relation[place]], entity[self.tail[place]]

    def _gathered(self, table: Tensor, ids: Tensor) -> Tensor:
        """Rows of a stack of tables, (M, N', d), one for each triple; shape (N, d)."""
        return table.flatten(0, 1).index_select(0, self.model * table.shape[1] + ids)

    def _summed(self, values: Tensor, ids: Tensor, number: int) -> Tensor:
        """Sums by model and id of values of shape (N, d); shape (M, number, d)."""
        table = values.new_zeros(self.shape[0] * number, values.shape[-1])
        return table.index_add_(0, self.model * number + ids, values).view(self.shape[0], number, -1)


Triples = DenseTriples | TripleList
