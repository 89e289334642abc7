"""A model: the score of a triple, from which all ways to rank and all gradients follow.

A model is a frozen dataclass whose fields are its options, registered under a name. One that has a ``score`` of its
own derives from ``Model``: everything else follows, one embedding of the stack after the other, with gradients by
autograd. One whose relations map a head derives from ``RelationMapModel``: all pairs of mapped heads and tails are then
scored at once, and its map alone is left to autograd, or has a gradient in closed form (``map``).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import torch
from torch import Tensor

from isi.config import Count, Name, Plugins, Positive, Section, keywords
from isi.models.scoring import Backward, Interaction, Product, Triples

BUDGET = 2**24  #: Numbers in intermediate results, at most, where entities are scored query by query.


class Model(ABC):
    """How a triple is scored: f(h, r, t) of a head, a relation and a tail.

    Tables of a stack are (M, E, d) for entities and (M, R, w) for relations, where w is ``width``.
    """

    linear: ClassVar[bool] = False  #: f(h, r, t) = ⟨transform(h, r), t⟩ = ⟨h, transform_tail(t, r)⟩
    invertible: ClassVar[bool] = True  #: whether ``transform`` and ``inverse`` are known
    distance: ClassVar[bool] = False  #: whether f = margin - a distance, with the margin as an option
    complex_vectors: ClassVar[bool] = False  #: whether vectors are complex numbers, real halves before imaginary ones
    angles: ClassVar[bool] = False  #: whether the row of a relation holds angles

    def width(self, dimension: int) -> int:
        """Length of a relation's row for vectors of ``dimension``; ``InputError`` where the dimension is impossible."""
        return dimension

    def half_range(self, given: float) -> float:
        """Relation tables start uniform in ± this; ``given`` is the half range of entity tables."""
        return given

    @abstractmethod
    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        """f of vectors; shapes (..., d), (..., w), (..., d), broadcast against each other, result (...)."""

    @abstractmethod
    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """The head mapped by the relation: the tail that it expects; shapes (..., d), (..., w)."""

    @abstractmethod
    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """The inverse map: the head that a tail expects; shapes (..., d), (..., w)."""

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """The tail as heads see it: interaction(transform(h, r), t) = interaction(h, transform_tail(t, r))."""
        return self.inverse(vectors, relation)

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as tail; shapes (M, Q, d), (M, Q, w), (M, E, d), result (M, Q, E)."""
        return _in_parts(lambda h, r, e: self.score(h[:, None], r[:, None], e), head, relation, entity)

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as head; shapes (M, Q, d), (M, Q, w), (M, E, d), result (M, Q, E)."""
        return _in_parts(lambda t, r, e: self.score(e, r[:, None], t[:, None]), tail, relation, entity)

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        """Scores of triples, and gradients of Σ slope · f by both tables, from slopes that may be the same memory."""
        _, scores = triples.empty(entity)
        return scores, _by_autograd(self.score, entity, relation, triples, scores)


class RelationMapModel(Model):
    """A model whose relations map heads: f(h, r, t) = interaction(transform(h, r), t)."""

    @property
    def interaction(self) -> Interaction:
        """The score of a mapped head and a tail: a product, unless a model overrides it."""
        return Product()

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return self.interaction.rows(self.transform(head, relation), tail)[0]

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return self.interaction.pairs(self.transform(head, relation), entity)[0]

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return self.interaction.pairs(self.transform_tail(tail, relation), entity)[0]

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        mapped, map_backward = self.map(entity, relation, triples)
        scores, interaction_backward = triples.interact(self.interaction, mapped, entity)

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = interaction_backward(slope)
            by_head, by_relation = map_backward(by_mapped)
            return by_tail.add_(by_head), by_relation

        return scores, backward

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        """Mapped heads of triples (see ``Triples.empty``), and the backward function to both tables' gradients."""
        memory, mapped = triples.empty(entity, entity.shape[-1])
        return memory, _by_autograd(lambda h, r, _: self.transform(h, r), entity, relation, triples, mapped)


def _by_autograd(
    function: Callable[[Tensor, Tensor, Tensor], Tensor], entity: Tensor, relation: Tensor, triples: Triples,
    values: Tensor,
) -> Backward:  # fmt: skip
    """Write a function's ``values`` for heads, relations and tails, and return its backward function."""
    for model, place, (h, r, t) in triples.parts():
        vectors = entity[model][h], relation[model][r], entity[model][t]
        values[place] = function(*vectors).view_as(values[place])

    def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
        total = torch.zeros_like(entity), torch.zeros_like(relation)
        for model, place, (h, r, t) in triples.parts():
            tables = entities, relations = tuple(table[model].detach().requires_grad_() for table in (entity, relation))
            with torch.enable_grad():
                result = function(entities[h], relations[r], entities[t])
            gradients = torch.autograd.grad(result, tables, slope[place].view_as(result))
            for table, gradient in zip(total, gradients, strict=True):
                table[model] += gradient
        return total

    return backward


def _in_parts(
    score: Callable[[Tensor, Tensor, Tensor], Tensor], known: Tensor, relation: Tensor, entity: Tensor
) -> Tensor:
    """Scores of all entities, for as many queries at a time as ``BUDGET`` allows."""
    number = max(1, BUDGET // entity[0].numel())
    return torch.stack([
        torch.cat([score(k, r, e) for k, r in zip(ks.split(number), rs.split(number), strict=True)])
        for ks, rs, e in zip(known, relation, entity, strict=True)
    ])  # fmt: skip


M = TypeVar("M", bound=type[Model])

MODELS: Plugins[type[Model]] = Plugins("isi.models")


class EmbeddingParams(Section):
    """``embedding`` in params: the model, the dimension, and how tables are initialized."""

    renamed: ClassVar = {"family": "model"}
    model: Name
    dimension: Count
    init_range: Positive


def register_model(name: str) -> Callable[[M], M]:
    """Register a dataclass as the model of a name; its fields are its options."""

    def register(kind: M) -> M:
        MODELS.register(name, kind)
        return kind

    return register


def make_model(name: str, options: Mapping[str, Any], key: str) -> Model:
    """The model of a name, with its options, or an ``InputError`` at a key where they do not fit."""
    kind = MODELS.get(name, key)
    return kind(**keywords(kind.__init__, options, key))
