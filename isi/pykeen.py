"""Insertion of new entities into a copy of a model trained by PyKEEN."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.optim import Optimizer

try:
    from pykeen.models import ERModel
    from pykeen.nn import modules
    from pykeen.nn.representation import Embedding as Table
    from pykeen.nn.representation import Representation
    from pykeen.triples import CoreTriplesFactory, TriplesFactory
except ModuleNotFoundError as error:
    raise ImportError("isi.pykeen needs PyKEEN: pip install pykeen") from error

from isi.config import check
from isi.errors import InputError, short
from isi.initializers.api import NoRelationMap
from isi.insertion import api
from isi.insertion.arguments import Source, Triple, argument, as_list
from isi.insertion.result import Inserted
from isi.models.bilinear import ComplEx, DistMult
from isi.models.distance import RotatE, TransE, TransEL1
from isi.models.model import Model
from isi.models.stack import Embedding

__all__ = ["enlarge", "insert", "inserted", "warm"]

PykeenModel = ERModel[Any, Any, Any]
ROUNDING = 1e-3  #: Tolerance of |r| = 1 for the relations of RotatE.


def insert(
    model: PykeenModel, factory: CoreTriplesFactory, triples: Sequence[Triple] | np.ndarray | Tensor, **arguments: Any
) -> tuple[PykeenModel, CoreTriplesFactory]:
    """Insert new entities into a copy of a trained model. Known vectors do not change.

    Args:
        model: has one vector per entity, no inverse triples. DistMult and ComplEx work with all initializers, TransE
            (L1, L2, squared) and RotatE with all but ridge, others with those that need no inverse (mean, es, ...).
        factory: the triples factory that the model was trained on.
        triples: (head, relation, tail) of the new entities, as labels (if the factory has labels) or ids.
        arguments: keyword arguments of ``inserted``.

    Returns:
        copies of the model, with the vectors of new entities as last rows, and of the factory, with their labels and
        triples. PyKEEN can predict with, evaluate, train and save them.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.
    """
    return enlarge(model, factory, inserted(model, factory, triples, **arguments))


def inserted(
    model: PykeenModel, factory: CoreTriplesFactory, triples: Sequence[Triple] | np.ndarray | Tensor, *,
    new: int | Sequence[str] | None = None, words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, margin: float | None = None,
    seed: int = 0,
) -> Inserted:  # fmt: skip
    """Compute the vectors of new entities with ``isi.insert``, which documents the other arguments.

    Args:
        new: labels of the new entities (null: all labels in ``triples`` that the factory lacks); their number if the
            factory has no labels.
        margin: added to scores (except of DistMult and ComplEx), so that score 0 means probability ½; null: estimated
            from scores of the factory's triples and of corrupted ones.
    """
    check(margin, Annotated[float, Field(allow_inf_nan=False)] | None, "", "argument 'margin'")  # type: ignore[arg-type]
    with argument("triples"):
        rows: Any = triples.cpu().numpy() if isinstance(triples, Tensor) else triples
        rows = rows if isinstance(rows, np.ndarray) and rows.ndim else as_list(rows)
    with argument("factory"):
        if not isinstance(factory, CoreTriplesFactory):
            raise InputError("", "", f"expected a triples factory of PyKEEN's, got {short(factory)}")
        expected = f"{table_of(model).max_id} entities and {model.num_real_relations} relations"
        if (got := f"{factory.num_entities} entities and {factory.real_num_relations} relations") != expected:
            raise InputError("", "", f"expected {expected}, as the model has, got {got}")
        labels = list[list[str] | None]([None, None])
        if isinstance(factory, TriplesFactory):
            labels = [sorted(ids, key=ids.__getitem__) for ids in (factory.entity_to_id, factory.relation_to_id)]
            if (number := len(set(factory.entity_to_id.values()))) != factory.num_entities:
                raise InputError("", "", f"expected labels of all {factory.num_entities} entities, got {number}")
    embedding = read_model(model, factory.mapped_triples, margin)
    if new is None:
        if not isinstance(factory, TriplesFactory):
            raise InputError("argument 'new'", "", "expected the number of new entities: the factory has no labels")
        whole = [tuple(triple) for triple in rows if hasattr(triple, "__len__") and len(triple) == 3]
        ends = dict.fromkeys(end for head, _, tail in whole for end in (head, tail) if isinstance(end, str))
        new = [str(end) for end in ends if end not in factory.entity_to_id]
    return api.insert(
        embedding.entity[0].numpy(), embedding.relation[0].numpy(), rows, new=new, model=embedding.model,
        entity_names=labels[0], relation_names=labels[1], known_triples=factory.mapped_triples.numpy(), words=words,
        word_source=word_source, kinds=kinds, initializer=initializer, options=options, seed=seed,
    )  # fmt: skip


def enlarge(model: PykeenModel, factory: CoreTriplesFactory, done: Inserted) -> tuple[PykeenModel, CoreTriplesFactory]:
    """Copies of a model and its factory, with the vectors, labels and triples of the new entities of ``done``."""
    larger = deepcopy(model)
    larger.num_entities = len(done.entities)
    table = table_of(larger)
    values = Form(tuple(table.shape), table.is_complex).values(torch.from_numpy(done.entities[done.known :]))
    values = values if table.constrainer is None else table.constrainer(values)
    values = torch.view_as_real(values) if table.is_complex else values
    weight = table._embeddings.weight
    new_rows = values.reshape(len(values), -1).to(weight)
    weight.data, weight.grad = torch.cat([weight.data, new_rows]), None  # same Parameter: regularizers may refer to it
    table.max_id = table._embeddings.num_embeddings = len(weight)
    new = torch.from_numpy(np.concatenate([done.insert_triples, done.between]))
    triples, metadata = torch.cat([factory.mapped_triples, new]), dict(factory.metadata)
    if not isinstance(factory, TriplesFactory):
        return larger, CoreTriplesFactory(triples, len(weight), factory.real_num_relations, metadata=metadata)
    labels = dict(factory.entity_to_id) | {str(done.names.of(row)): row for row in done.new}
    return larger, TriplesFactory(triples, labels, factory.relation_to_id, metadata=metadata)


def warm(optimizer: Optimizer) -> Optimizer:
    """Prepare an optimizer, in place, for PyKEEN's ``train(continue_training=True)``, which does not reset vectors."""
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            optimizer.state[parameter]  # creates an empty entry; PyKEEN refuses an optimizer without state
    return optimizer


@dataclass(frozen=True)
class Form:
    """Shape and type of a value stored as a row of real numbers; if complex, the real half, then the imaginary half."""

    shape: tuple[int, ...]
    is_complex: bool

    @property
    def size(self) -> int:
        """Length of a row: the product of ``shape``, twice that if complex."""
        return prod(self.shape) * (1 + self.is_complex)

    def values(self, rows: Tensor) -> Tensor:
        """Convert rows of shape (..., size) to values of shape (..., *shape)."""
        if self.is_complex:
            rows = torch.complex(*(half.contiguous() for half in rows.chunk(2, -1)))
        return rows.reshape(*rows.shape[:-1], *self.shape)


@dataclass(frozen=True, eq=False)
class InteractionModel(Model):
    """f(h, r, t) = ``offset`` + score of a PyKEEN interaction. It has no ``transform`` and no ``inverse``."""

    interaction: modules.Interaction[Any, Any, Any]
    entity: Form
    relations: tuple[Form, ...]
    offset: float
    #: initializers that need an inverse refuse this model
    invertible: ClassVar[bool] = False

    def width(self, dimension: int) -> int:  # noqa: ARG002
        return sum(form.size for form in self.relations)

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        parts = torch.split(relation.double(), [form.size for form in self.relations], -1) if self.relations else ()
        values = tuple(form.values(part) for form, part in zip(self.relations, parts, strict=True))
        first, last = (self.entity.values(vectors.double()) for vectors in (head, tail))
        scores: Tensor = self.interaction(h=first, r=values[0] if len(values) == 1 else values, t=last)
        return self.offset + scores.to(head.dtype)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap


def table_of(model: PykeenModel) -> Table:
    """The entity table of a model; InputError unless the model has exactly one."""
    parts = model.entity_representations if isinstance(model, ERModel) else []
    if len(parts) != 1 or not isinstance(parts[0], Table):
        raise InputError("argument 'model'", type(model).__name__, "expected a model with one vector for each entity")
    return parts[0]


def read_model(model: PykeenModel, triples: Tensor, margin: float | None) -> Embedding:
    """Read a model as a stack of one embedding; a null margin is estimated from ``triples``, shape (T, 3)."""
    form, entity = _read(table_of(model))
    if model.use_inverse_triples:
        raise InputError("argument 'model'", "", "expected a model that was trained without inverse triples")
    read = [_read(representation) for representation in model.relation_representations]
    forms, tables = tuple(form for form, _ in read), [rows for _, rows in read]
    if closed := _closed_form(model.interaction, tables):
        make, rows = closed
        embedding = Embedding(entity[None].float(), rows[None].float(), make(0.0))
        return replace(embedding, model=make(api.margin_of(embedding, triples, margin)))
    interaction = deepcopy(model.interaction).cpu().double().eval().requires_grad_(False)
    rows = torch.cat(tables, 1) if tables else torch.zeros(model.num_relations, 0)
    scored = InteractionModel(interaction, form, forms, 0.0)
    scored = replace(scored, offset=api.margin_of(Embedding(entity[None], rows[None], scored), triples, margin))
    return Embedding(entity[None].float(), rows[None].float(), scored)


def _closed_form(
    interaction: modules.Interaction[Any, Any, Any], relations: Sequence[Tensor]
) -> tuple[Callable[[float], Model], Tensor] | None:
    """The equivalent of an interaction: margin → ``Model``, and its relation rows, (R, w); null if there is none."""
    if type(interaction) is modules.RotatEInteraction:
        real, imaginary = relations[0].chunk(2, 1)
        is_rotation = (torch.hypot(real, imaginary) - 1).abs().max() < ROUNDING
        return (lambda margin: RotatE(margin, False), torch.atan2(imaginary, real)) if is_rotation else None
    forms: dict[tuple[type, Any], Callable[[float], Model]] = {
        (modules.DistMultInteraction, None): lambda _: DistMult(),
        (modules.ComplExInteraction, None): lambda _: ComplEx(),
        (modules.TransEInteraction, 1): TransEL1,
        (modules.TransEInteraction, 2): lambda margin: TransE(margin, bool(interaction.power_norm)),
    }
    make = forms.get((type(interaction), getattr(interaction, "p", None)))
    return (make, relations[0]) if make else None


def _read(representation: Representation) -> tuple[Form, Tensor]:
    """Form and all rows, shape (N, size), of a representation in evaluation mode (no dropout; normalized)."""
    training = representation.training
    with torch.no_grad():
        values = representation.eval()().detach().cpu()
    representation.train(training)
    flat = values.flatten(1)
    rows = torch.cat([flat.real, flat.imag], 1) if values.is_complex() else flat
    return Form(tuple(representation.shape), values.is_complex()), rows
