"""What a family of embeddings says of itself, and all ways to score that follow from it.

A family is a frozen dataclass whose fields are its options. One that has a ``score`` of its own and
no more derives from ``Family``: everything else follows, one model after the other, with gradients
by autograd. One whose relations map heads to where they meet tails derives from ``Mapping``: all
pairs then meet at once, for a stack of models, and its map alone is left to autograd, or says its
gradient in closed form (``map``).

Families of embeddings, one module each, registered under the name of its file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import torch
from torch import Tensor

from isi.config import Count, Name, Positive, Section, keywords
from isi.models.interaction import Backward, Interaction
from isi.models.triples import Triples
from isi.registry import Plugins

#: Numbers in intermediate results, at most, where entities are scored one by one.
BUDGET = 2**24


class Model(ABC):
    """How a triple is scored: f(h, r, t) of a head, a relation and a tail.

    Tables of a stack are (M, E, d) for entities and (M, R, w) for relations, where w is ``width``.
    """

    def width(self, dimension: int) -> int:
        """Numbers in a relation's row, where a vector has ``dimension``.

        Raises:
            InputError: where the family has no vectors of this dimension.
        """
        return dimension

    def half_range(self, given: float) -> float:
        """Relation tables start uniform in ± this; ``given`` is what those of entities start in."""
        return given

    @abstractmethod
    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        """f of vectors; shapes (..., d), (..., w), (..., d), broadcast against each other, result (...)."""

    @abstractmethod
    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Where a relation takes a head: the tail that it expects; shapes (..., d), (..., w)."""

    @abstractmethod
    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Where the head of a tail must be; shapes (..., d), (..., w)."""

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Where unmapped heads meet a tail; where nothing else is said, where the head must be."""
        return self.inverse(vectors, relation)

    @property
    def linear(self) -> bool:
        """Whether f is linear in a head and in a tail: f(h, r, t) = ⟨transform(h, r), t⟩ = ⟨h, pullback(t, r)⟩."""
        return False

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as tail; shapes (M, Q, d), (M, Q, w), (M, E, d), result (M, Q, E)."""
        return _one_by_one(lambda h, r, e: self.score(h[:, None], r[:, None], e), head, relation, entity)

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as head; shapes (M, Q, d), (M, Q, w), (M, E, d), result (M, Q, E)."""
        return _one_by_one(lambda t, r, e: self.score(e, r[:, None], t[:, None]), tail, relation, entity)

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        """Scores of triples, and the gradients of Σ slope · f by both tables, as a function of the slopes.

        The slopes are of the shape of the scores, which they may have overwritten.
        """
        scores = triples.empty_scores(entity)
        for model, place, pick in triples.one_by_one():
            scores[place] = self.score(*pick(entity[model], relation[model]))

        def pull(slope: Tensor) -> tuple[Tensor, Tensor]:
            total = torch.zeros_like(entity), torch.zeros_like(relation)
            for model, place, pick in triples.one_by_one():
                with torch.enable_grad():
                    tables = _leaves(entity[model], relation[model])
                    score = self.score(*pick(*tables))
                for sums, part in zip(total, torch.autograd.grad(score, tables, slope[place]), strict=True):
                    sums[model] += part
            return total

        return scores, pull


class RelationMapModel(Model):
    """Relations that map a head to where it meets a tail: f(h, r, t) = meeting(transform(h, r), t)."""

    @property
    @abstractmethod
    def interaction(self) -> Interaction:
        """How a mapped head meets a tail."""

    @abstractmethod
    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Where unmapped heads meet a tail: meeting(transform(h, r), t) = meeting(h, pullback(t, r)).

        The transposed map for a product, the inverse for a distance that the map keeps.
        """

    @property
    def linear(self) -> bool:
        return self.interaction.linear

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return self.interaction.score(self.transform(head, relation), tail)

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return self.interaction.pairs(self.transform(head, relation), entity)[0]

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return self.interaction.pairs(self.transform_tail(tail, relation), entity)[0]

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        rows, pull_map = self.map(entity, relation, triples)
        scores, pull_meeting = triples.meet(self.interaction, rows, entity)

        def pull(slope: Tensor) -> tuple[Tensor, Tensor]:
            by_mapped, by_tail = pull_meeting(slope)
            by_head, by_relation = pull_map(by_mapped)
            return by_tail.add_(by_head), by_relation

        return scores, pull

    def map(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        """Mapped heads of triples, in their ``room``, and the gradients of what pulls at them by both tables."""
        rows, mapped = triples.room(entity)
        for model, place, pick in triples.one_by_one():
            head, row, _ = pick(entity[model], relation[model])
            mapped[place] = self.transform(head, row).view_as(mapped[place])

        def pull(by_mapped: Tensor) -> tuple[Tensor, Tensor]:
            total = torch.zeros_like(entity), torch.zeros_like(relation)
            for model, place, pick in triples.one_by_one():
                with torch.enable_grad():
                    tables = _leaves(entity[model], relation[model])
                    head, row, _ = pick(*tables)
                    reached = self.transform(head, row)
                pulled = by_mapped[place].view_as(reached)
                for sums, part in zip(total, torch.autograd.grad(reached, tables, pulled), strict=True):
                    sums[model] += part
            return total

        return rows, pull


def _leaves(*tables: Tensor) -> tuple[Tensor, ...]:
    """Tables by which autograd can take a gradient."""
    return tuple(table.detach().requires_grad_() for table in tables)


def _one_by_one(
    score: Callable[[Tensor, Tensor, Tensor], Tensor], known: Tensor, relation: Tensor, entity: Tensor
) -> Tensor:
    """Scores of all entities, model by model, for as many queries at once as ``BUDGET`` allows."""
    at_once = max(1, BUDGET // entity[0].numel())
    return torch.stack([
        torch.cat([score(k, r, e) for k, r in zip(ks.split(at_once), rs.split(at_once), strict=True)])
        for ks, rs, e in zip(known, relation, entity, strict=True)
    ])  # fmt: skip


F = TypeVar("F", bound=type[Model])

MODELS: Plugins[type[Model]] = Plugins("isi.models")


class EmbeddingParams(Section):
    """``embedding`` in params: which model embeddings have, and how their tables start."""

    renamed: ClassVar = {"family": "model"}
    model: Name
    dimension: Count
    init_range: Positive


def register_model(name: str) -> Callable[[F], F]:
    """Register a dataclass as the family of a name; its fields are its options."""

    def register(kind: F) -> F:
        MODELS.register(name, kind)
        return kind

    return register


def make_model(name: str, options: Mapping[str, Any], key: str) -> Model:
    """The family of a name, with its options.

    Raises:
        InputError: where there is none, or it does not take these options; ``key`` is where they stand.
    """
    kind = MODELS.get(name, key)
    return kind(**keywords(kind.__init__, options, key))
