"""A model: the score of a triple, and from it the ranking of candidates and the gradients.

A model is a frozen dataclass, registered under a name; its fields are its options. A subclass of
``Model`` defines ``score``, ``transform`` and ``inverse``: the embeddings of a stack are scored one
after the other, with gradients by autograd. If relations map heads, a subclass of
``RelationMapModel`` defines ``transform`` and ``inverse``: all pairs of mapped heads and tails are
scored together, and only the map needs autograd, or a closed-form gradient (``map``).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeVar, get_args

import torch
from torch import Tensor
from torch.linalg import vector_norm
from torch.nn.functional import normalize

from isi.config import Count, Name, Plugins, Positive, Section, keywords
from isi.models.scoring import Backward, Interaction, Product, Triples

#: Maximum number of elements in an intermediate tensor when ``Model`` scores all entities of a
#: query.
BUDGET = 2**24
#: Where entity vectors lie: anywhere, on the unit sphere, or in the unit ball.
Constraint = Literal["none", "sphere", "ball"]
CONSTRAINTS: tuple[Constraint, ...] = get_args(Constraint)


class Model(ABC):
    """The score f(h, r, t) of a head, a relation and a tail.

    Tables of a stack have the shapes (M, E, d) for entities and (M, R, w) for relations, with w =
    ``width(d)``.

    Example:
        >>> import torch
        >>> from isi.models.bilinear import DistMult
        >>> head, relation, tail = torch.tensor([[1.0, 2.0], [3.0, -1.0], [1.0, 0.5]])
        >>> DistMult().score(head, relation, tail)
        tensor(2.)
        >>> DistMult().transform(head, relation)
        tensor([ 3., -2.])
    """

    linear: ClassVar[bool] = False  #: whether f = ⟨transform(h, r), t⟩ = ⟨h, transform_tail(t, r)⟩
    invertible: ClassVar[bool] = True  #: whether ``transform`` and ``inverse`` are known
    #: whether f = margin - a distance, with the margin as an option
    distance: ClassVar[bool] = False
    #: whether vectors are complex numbers, real halves before imaginary ones
    complex_vectors: ClassVar[bool] = False
    angles: ClassVar[bool] = False  #: whether the row of a relation holds angles
    #: options where none are given
    defaults: ClassVar[Mapping[str, Any]] = {}

    def width(self, dimension: int) -> int:
        """Length of a relation's row for vectors of ``dimension``;
        ``InputError`` where the dimension is impossible.
        """
        return dimension

    def half_range(self, of_entities: float) -> float:
        """Half range of the uniform distribution that initializes relations;
        ``of_entities`` is that of entities.
        """
        return math.pi if self.angles else of_entities

    @abstractmethod
    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        """f of rows of the tables; shapes (..., d), (..., w), (..., d), which broadcast;
        result (...).
        """

    @abstractmethod
    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Heads ``vectors``, (..., d), mapped by relations, (..., w), to their expected tails;
        shape (..., d).
        """

    @abstractmethod
    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Tails ``vectors``, (..., d), mapped back by relations, (..., w), to their expected heads;
        shape (..., d).
        """

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        """Tails mapped such that interaction(transform(h, r), t) =
        interaction(h, transform_tail(t, r)); (..., d).
        """
        return self.inverse(vectors, relation)

    def constrain(self, vectors: Tensor) -> Tensor:
        """Entity vectors, (..., d), as the trainer keeps them: each row by itself, and a row that
        it returns stays as it is. By default, all vectors are allowed.
        """
        return vectors

    @property
    def is_free(self) -> bool:
        """Whether all entity vectors are allowed: ``constrain`` is not replaced."""
        return type(self).constrain is Model.constrain

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as tail; shapes (M, Q, d), (M, Q, w), (M, E, d),
        result (M, Q, E).
        """
        return _in_parts(
            lambda h, r, e: self.score(h[:, None], r[:, None], e), head, relation, entity
        )

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        """Scores of all entities as head; shapes (M, Q, d), (M, Q, w), (M, E, d),
        result (M, Q, E).
        """
        return _in_parts(
            lambda t, r, e: self.score(e, r[:, None], t[:, None]), tail, relation, entity
        )

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        """Scores f of triples, and a function from slopes (which may overwrite f) to both
        gradients of Σ slope · f.
        """
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
        """Mapped heads, in memory of ``triples.empty``;
        a function from their gradient to those of both tables.
        """
        memory, mapped = triples.empty(entity, entity.shape[-1])
        return memory, _by_autograd(
            lambda h, r, _: self.transform(h, r), entity, relation, triples, mapped
        )


@dataclass(frozen=True)
class ConstrainedModel(RelationMapModel):
    """A model whose entity vectors may have a constraint."""

    #: of entity vectors; not of relations
    constraint: Constraint = field(default="none", kw_only=True)

    def constrain(self, vectors: Tensor) -> Tensor:
        """Vectors, (..., d), divided by their length, or in a ball by their length if above 1."""
        if self.constraint == "sphere":
            unit: Tensor = normalize(vectors, dim=-1)
            return unit
        if self.constraint == "ball":
            lengths: Tensor = vector_norm(vectors, dim=-1, keepdim=True)
            return vectors / lengths.clamp(min=1)
        return vectors

    @property
    def is_free(self) -> bool:
        is_replaced = type(self).constrain is not ConstrainedModel.constrain
        return self.constraint == "none" and not is_replaced


def _by_autograd(
    function: Callable[[Tensor, Tensor, Tensor], Tensor],
    entity: Tensor,
    relation: Tensor,
    triples: Triples,
    values: Tensor,
) -> Backward:
    """Write a function's results for all triples into ``values``;
    returns its backward function, by autograd.
    """
    for model, place, (h, r, t) in triples.parts():
        vectors = entity[model][h], relation[model][r], entity[model][t]
        values[place] = function(*vectors).view_as(values[place])

    def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
        total = torch.zeros_like(entity), torch.zeros_like(relation)
        for model, place, (h, r, t) in triples.parts():
            tables = entities, relations = tuple(
                table[model].detach().requires_grad_() for table in (entity, relation)
            )
            with torch.enable_grad():
                result = function(entities[h], relations[r], entities[t])
            gradients = torch.autograd.grad(result, tables, slope[place].view_as(result))
            for table, gradient in zip(total, gradients, strict=True):
                table[model] += gradient
        return total

    return backward


def _in_parts(
    score: Callable[[Tensor, Tensor, Tensor], Tensor],
    known: Tensor,
    relation: Tensor,
    entity: Tensor,
) -> Tensor:
    """Scores of all entities, (M, Q, E), in chunks of queries that fit into ``BUDGET``."""
    number = max(1, BUDGET // entity[0].numel())
    return torch.stack(
        [
            torch.cat(
                [score(k, r, e) for k, r in zip(ks.split(number), rs.split(number), strict=True)]
            )
            for ks, rs, e in zip(known, relation, entity, strict=True)
        ]
    )


M = TypeVar("M", bound=type[Model])

MODELS: Plugins[type[Model]] = Plugins("isi.models")


class EmbeddingParams(Section):
    """``embedding`` in params: the model, the dimension, and how tables are initialized."""

    model: Name
    dimension: Count
    init_range: Positive


def register_model(name: str, *, defaults: Mapping[str, Any] | None = None) -> Callable[[M], M]:
    """Register a dataclass as a model under a name; its fields are the options.

    ``defaults``: see ``Model``; a registered class inherits none.

    Example:
        >>> from dataclasses import dataclass
        >>> from isi.models.distance import TransE
        >>> @register_model("near", defaults={"margin": 1.0})
        ... @dataclass(frozen=True)
        ... class Near(TransE):
        ...     pass
        >>> make_model("near", {"margin": 3.0}, "models.near")
        Near(constraint='none', margin=3.0, squared=False)
    """

    def register(kind: M) -> M:
        kind.defaults = defaults or {}
        MODELS.register(name, kind)
        return kind

    return register


def make_model(name: str, options: Mapping[str, Any], key: str) -> Model:
    """The model registered under a name, with options;
    ``InputError`` at the key if name or options do not fit.

    Example:
        >>> make_model("transe", {"margin": 2.0}, "models.transe")
        TransE(constraint='none', margin=2.0, squared=False)
    """
    kind = MODELS.get(name, key)
    return kind(**keywords(kind.__init__, options, key))


def name_of(model: Model) -> str | None:
    """The name under which a model's class is registered; None if it is not."""
    return next((name for name in MODELS.names() if type(model) is MODELS.get(name)), None)


def stored_options(model: Model) -> dict[str, Any]:
    """The options of a registered model, as a folder stores them: without a constraint if there is
    none, so that folders are those of versions without this option.
    """
    options = dict(vars(model))
    if options.get("constraint") == "none":
        del options["constraint"]
    return options
