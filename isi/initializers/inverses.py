"""Models with inverse relations: each triple (h, r, t) counts as (t, inverse of r, h), too.

They have two forms. Packed: R rows, (R, 2w); the first half of row r is relation r, the second half
its inverse; each triple once. Unpacked, as in PyKEEN: 2R rows, (2R, w); row 2r is relation r, row
2r + 1 its inverse; each triple in both directions.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.api import InitResult, Registered
from isi.initializers.context import InitContext, NewRows
from isi.models.model import Model
from isi.models.stack import Embedding


@dataclass(frozen=True, eq=False)
class InverseRelations(Model):
    """The packed form of a model ``base``. It predicts tails by f(h, r, ?),
    and heads by f(t, inverse of r, ?).
    """

    base: Model
    #: if false, it predicts heads by f(?, r, t), so that a triple has one score
    heads_by_inverse: bool = True

    @property
    def linear(self) -> bool:  # type: ignore[override]
        return self.base.linear

    @property
    def invertible(self) -> bool:  # type: ignore[override]
        return self.base.invertible

    @property
    def is_free(self) -> bool:
        return self.base.is_free

    def constrain(self, vectors: Tensor) -> Tensor:
        return self.base.constrain(vectors)

    def width(self, dimension: int) -> int:
        return 2 * self.base.width(dimension)

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return self.base.score(head, relation.chunk(2, -1)[0], tail)

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return self.base.score_tails(head, relation.chunk(2, -1)[0], entity)

    def score_heads(self, tail: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        forward, backward = relation.chunk(2, -1)
        if self.heads_by_inverse:
            return self.base.score_tails(tail, backward, entity)
        return self.base.score_heads(tail, forward, entity)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.base.transform(vectors, relation.chunk(2, -1)[0])

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.base.transform_tail(vectors, relation.chunk(2, -1)[0])

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.base.transform(vectors, relation.chunk(2, -1)[1])


def pack(theta: Embedding) -> Embedding:
    """The packed form of an embedding in the unpacked form, with 2R relations."""
    models, relations, width = theta.relation.shape
    return Embedding(
        theta.entity,
        theta.relation.reshape(models, relations // 2, 2 * width),
        InverseRelations(theta.model),
    )


def unpack(theta: Embedding) -> Embedding:
    """The unpacked form of an embedding in the packed form; another embedding as it is."""
    if not isinstance(theta.model, InverseRelations):
        return theta
    models, relations, width = theta.relation.shape
    return Embedding(
        theta.entity, theta.relation.reshape(models, 2 * relations, width // 2), theta.model.base
    )


def both_ways(triples: Tensor) -> Tensor:
    """Triples (h, 2r, t), then (t, 2r + 1, h), of triples (h, r, t);
    shapes (T, 3), result (2T, 3).
    """
    forward, backward = triples.clone(), triples[:, [TAIL, RELATION, HEAD]]
    forward[:, RELATION] *= 2
    backward[:, RELATION] = forward[:, RELATION] + 1
    return torch.cat([forward, backward])


def unpack_first(initializer: Registered, model: Model) -> Registered:
    """The initializer, which sees the unpacked form of an embedding in the packed form;
    unchanged for other models.
    """
    if not isinstance(model, InverseRelations):
        return initializer

    def initialize(packed: InitContext, **options: object) -> InitResult:
        confidence = packed.confidence
        if confidence is not None:
            confidence = torch.cat([confidence, confidence], -1)
        context = replace(
            packed,
            theta0=unpack(packed.theta0),
            other=torch.cat([packed.other, packed.other], -1),
            relation=torch.cat([2 * packed.relation, 2 * packed.relation + 1], -1),
            novel_is_tail=torch.cat([packed.novel_is_tail, ~packed.novel_is_tail], -1),
            observed=torch.cat([packed.observed, packed.observed], -1),
            triples=both_ways(packed.triples),
            trained=torch.cat([packed.trained, packed.trained], -1),
            confidence=confidence,
            training=_unpacked(packed.training),
        )
        result: InitResult = initializer.function(context, **options)
        if result.relations is None:
            return result
        models, number, width = result.relations.shape
        rows = result.relations.reshape(models, number // 2, 2 * width)
        return replace(result, relations=rows)

    return replace(initializer, function=initialize)


def _unpacked(training: NewRows) -> NewRows:
    """What training needs, for the unpacked form."""
    triples = training.triples
    return replace(
        training,
        relations=2 * training.relations,
        triples=None if triples is None else both_ways(triples),
        tails_only=True,
    )
