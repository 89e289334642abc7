"""A model of PyKEEN's as an embedding of this project: with a model of our own, or one made of its interaction.

Its representations become rows of real numbers; complex ones are real halves, then imaginary ones.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod
from typing import Any, ClassVar

import torch
from pykeen.models import ERModel
from pykeen.nn.modules import (
    ComplExInteraction,
    DistMultInteraction,
    Interaction,
    RotatEInteraction,
    TransEInteraction,
)
from pykeen.nn.representation import Embedding as Table
from pykeen.nn.representation import Representation
from torch import Tensor

from isi.errors import InputError
from isi.initializers.api import NoRelationMap
from isi.insertion.choose import margin_of
from isi.models.bilinear import ComplEx, DistMult
from isi.models.distance import RotatE, TransE, TransEL1
from isi.models.model import Model
from isi.models.stack import Embedding

#: How far from 1 the length of a rotation may be.
ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class InteractionModel(Model):
    """f(h, r, t) = offset + the score of an interaction of PyKEEN's; the map of its relations is not known."""

    interaction: Interaction[Any, Any, Any]
    entity: Form
    relations: tuple[Form, ...]
    offset: float
    #: see ``isi.insert``
    invertible: ClassVar[bool] = False

    def width(self, dimension: int) -> int:  # noqa: ARG002
        return sum(form.size for form in self.relations)

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        sizes = [form.size for form in self.relations]
        parts = torch.split(relation.double(), sizes, -1) if sizes else ()
        values = tuple(form.values(part) for form, part in zip(self.relations, parts, strict=True))
        first, last = (self.entity.values(vectors.double()) for vectors in (head, tail))
        scores: Tensor = self.interaction(h=first, r=values[0] if len(values) == 1 else values, t=last)
        return self.offset + scores.to(head.dtype)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap


def table_of(model: ERModel[Any, Any, Any]) -> Table:
    """The table that a model's entities are the rows of.

    Raises:
        InputError: where there is none, or more than one.
    """
    parts = model.entity_representations if isinstance(model, ERModel) else []
    if len(parts) != 1 or not isinstance(parts[0], Table):
        raise InputError("argument 'model'", type(model).__name__, "expected a model with one vector for each entity")
    return parts[0]


def read_model(model: ERModel[Any, Any, Any], triples: Tensor, margin: float | None) -> Embedding:
    """A model as a stack of one embedding.

    Args:
        triples: that it was trained on; their scores say the margin of distances where none is given.

    Raises:
        InputError: where it has several vectors per entity, or relations that are inverses of others.
    """
    form, entity = read(table_of(model))
    if model.use_inverse_triples:
        raise InputError("argument 'model'", "", "expected a model that was trained without inverse triples")
    relations = [read(representation) for representation in model.relation_representations]
    closed = _closed_form(model.interaction, [rows for _, rows in relations])
    if closed is None:
        interaction = deepcopy(model.interaction).cpu().double().eval().requires_grad_(False)
        rows = torch.cat([rows for _, rows in relations], 1) if relations else torch.zeros(model.num_relations, 0)
        scored = InteractionModel(interaction, form, tuple(form for form, _ in relations), 0.0)
        scored = replace(scored, offset=margin_of(Embedding(entity[None], rows[None], scored), triples, margin))
        return Embedding(entity[None].float(), rows[None].float(), scored)
    make, rows = closed
    without_margin = Embedding(entity[None].float(), rows[None].float(), make(0.0))
    return replace(without_margin, model=make(margin_of(without_margin, triples, margin)))


def _closed_form(
    interaction: Interaction[Any, Any, Any], relations: list[Tensor]
) -> tuple[Callable[[float], Model], Tensor] | None:
    """A model of our own for an interaction, by its margin, and its rows of relations; null where there is none."""
    if type(interaction) is DistMultInteraction:
        return lambda _: DistMult(), relations[0]
    if type(interaction) is ComplExInteraction:
        return lambda _: ComplEx(), relations[0]
    if type(interaction) is TransEInteraction and interaction.p == 2:
        return lambda margin: TransE(margin, bool(interaction.power_norm)), relations[0]
    if type(interaction) is TransEInteraction and interaction.p == 1:
        return lambda margin: TransEL1(margin), relations[0]
    if type(interaction) is RotatEInteraction:
        real, imaginary = relations[0].chunk(2, 1)
        if (torch.hypot(real, imaginary) - 1).abs().max() < ROUNDING:
            return lambda margin: RotatE(margin, False), torch.atan2(imaginary, real)
    return None


@dataclass(frozen=True)
class Form:
    """How a row of real numbers lies in a representation."""

    shape: tuple[int, ...]
    is_complex: bool

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return prod(self.shape) * (1 + self.is_complex)

    def rows(self, values: Tensor) -> Tensor:
        """Values of shape (N, *shape) as rows, (N, size)."""
        flat = values.flatten(1)
        return torch.cat([flat.real, flat.imag], 1) if self.is_complex else flat

    def values(self, rows: Tensor) -> Tensor:
        """Rows of shape (..., size) as values, (..., *shape)."""
        if self.is_complex:
            rows = torch.complex(*(half.contiguous() for half in rows.chunk(2, -1)))
        return rows.reshape(*rows.shape[:-1], *self.shape)


def read(representation: Representation) -> tuple[Form, Tensor]:
    """The form of a representation, and all its rows; without dropout, after its normalizer."""
    training = representation.training
    with torch.no_grad():
        values = representation.eval()().detach().cpu()
    representation.train(training)
    form = Form(tuple(representation.shape), values.is_complex())
    return form, form.rows(values)
