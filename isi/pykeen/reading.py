"""A model of PyKEEN as an embedding: its tables, joined to one row for each entity and relation,
and its score.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from itertools import product
from math import prod
from typing import Any, ClassVar, TypeVar

import torch
from pykeen import losses
from pykeen.models import ERModel
from pykeen.nn import modules
from pykeen.nn.representation import Embedding as Table
from pykeen.nn.representation import Representation
from pykeen.regularizers import Regularizer
from torch import Tensor
from torch.nn import Module
from torch.nn.functional import normalize

from isi.errors import InputError
from isi.initializers.api import NoRelationMap
from isi.initializers.inverses import both_ways
from isi.models.losses import Loss, TrainingLoss, loss_named
from isi.models.model import CONSTRAINTS, MODELS, ConstrainedModel, Model
from isi.models.stack import Embedding, margin_of

PykeenModel = ERModel[Any, Any, Any]
M = TypeVar("M", bound=Module)
WRAPPED = ("_orig_mod", "module")  #: Attributes under which wrappers of PyTorch hold a model.
ROUNDING = 1e-3  #: Tolerance of |r| = 1 for the relations of RotatE.
#: Losses of PyKEEN by which a score is the log odds of its triple.
LOGISTIC = (
    losses.SoftplusLoss,
    losses.BCEWithLogitsLoss,
    losses.BCEAfterSigmoidLoss,
)
#: Losses of PyKEEN that leave slope and border open; ``InfoNCELoss`` has a temperature of its own.
MARGIN = (
    losses.MarginPairwiseLoss,
    losses.DeltaPointwiseLoss,
    losses.DoubleMarginLoss,
    losses.InfoNCELoss,
    losses.MSELoss,
)
SAMPLES = 8  #: Random triples on which scores are compared.


@dataclass(frozen=True)
class Form:
    """Shape and type of a value stored as a row of real numbers;
    if complex, the real half, then the imaginary half.
    """

    shape: tuple[int, ...]
    is_complex: bool
    #: what PyKEEN applies to a table after each update, and to its rows whenever it reads them
    limits: tuple[Callable[[Tensor], Tensor], ...] = ()

    @property
    def size(self) -> int:
        """Length of a row: the product of ``shape``, twice that if complex."""
        return prod(self.shape) * (1 + self.is_complex)

    def values(self, rows: Tensor, limited: bool = True) -> Tensor:
        """Convert rows of shape (..., size) to values of shape (..., *shape),
        under the constraints if ``limited``.
        """
        if self.is_complex:
            rows = torch.complex(*(half.contiguous() for half in rows.chunk(2, -1)))
        values = rows.reshape(-1, *self.shape)  # a table, as constrainers expect it
        for limit in self.limits if limited else ():
            values = limit(values)
        return values.view(*rows.shape[:-1], *self.shape)


def parted(rows: Tensor, forms: Sequence[Form], limited: bool = True) -> list[Tensor]:
    """Split joined rows, (..., Σ size), into the values of each table, (..., *shape),
    under the constraints if ``limited``.
    """
    parts = torch.split(rows, [form.size for form in forms], -1) if forms else ()
    return [form.values(part, limited) for form, part in zip(forms, parts, strict=True)]


@dataclass(frozen=True, eq=False)
class InteractionModel(Model):
    """f(h, r, t) = ``offset`` + score of a PyKEEN interaction, of entity vectors as they are.
    It has no ``transform`` and no ``inverse``.

    A row joins the rows of all tables of an entity (SimplE, ConvE, ... have several), or of a
    relation; a relation without a table (UM) has a row of one zero.
    """

    interaction: modules.Interaction[Any, Any, Any]
    entities: tuple[Form, ...]
    relations: tuple[Form, ...]
    offset: float
    #: initializers that need an inverse refuse this model
    invertible: ClassVar[bool] = False

    def width(self, dimension: int) -> int:  # noqa: ARG002
        return max(1, sum(form.size for form in self.relations))

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        first, last = (
            parted(vectors.double(), self.entities, limited=False) for vectors in (head, tail)
        )
        sides = (
            [first[table] for table in self.interaction.head_indices],
            parted(relation.double(), self.relations),
            [last[table] for table in self.interaction.tail_indices],
        )
        h, r, t = (values[0] if len(values) == 1 else values for values in sides)
        scores: Tensor = self.interaction(h=h, r=r, t=t)
        # for the shape and the gradient
        scores = scores if self.relations else scores + 0 * relation[..., 0]
        return self.offset + scores.to(head.dtype)

    @property
    def is_free(self) -> bool:
        return not any(form.limits for form in self.entities)

    def constrain(self, vectors: Tensor) -> Tensor:
        """Joined rows, (..., d), under the constraints of their tables."""
        rows = vectors.flatten(0, -2).double()
        parts = [_flat(values) for values in parted(rows, self.entities)]
        return torch.cat(parts, 1).view(vectors.shape).to(vectors.dtype)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap


def unwrapped(model: Any) -> Any:
    """The model in a wrapper of ``torch.compile`` (``_orig_mod``) or of ``DataParallel``
    (``module``); else itself.
    """
    while isinstance(model, Module) and not isinstance(model, ERModel):
        inner = next((part for name, part in model.named_children() if name in WRAPPED), None)
        if inner is None:
            return model
        model = inner
    return model


def copied(module: M) -> M:
    """A deep copy of a module, which can be trained by itself.

    What a module keeps of a pass in training, such as the term of a regularizer, is copied without
    its gradient; the copy's regularizers start again at zero.
    """
    memory = dict[int, Any]()
    for part in module.modules():
        for tensor in _tensors_in(vars(part)):
            if not tensor.is_leaf:
                memory[id(tensor)] = tensor.detach().clone()
    copy = deepcopy(module, memory)
    for part in copy.modules():
        if isinstance(part, Regularizer):
            part.reset()
    return copy


def _tensors_in(values: Any) -> Iterator[Tensor]:
    """The tensors in nested dicts, lists and tuples."""
    if isinstance(values, Tensor):
        yield values
    elif isinstance(values, Mapping | list | tuple):
        for value in values.values() if isinstance(values, Mapping) else values:
            yield from _tensors_in(value)


def tables_of(model: object) -> list[Table]:
    """The entity tables of a model; InputError unless it stores all
    vectors of entities in tables.
    """
    if not isinstance(model, ERModel):
        expected = (
            "expected a model with vectors (ERModel of PyKEEN), or the result of its pipeline"
        )
        raise InputError("argument 'model'", type(model).__name__, expected)
    tables = []
    for part in model.entity_representations:
        if not isinstance(part, Table):
            problem = (
                f"{type(part).__name__} computes the vectors of entities, "
                "so no row can be added to them"
            )
            remedy = (
                "make the model with a factory of all triples, "
                "copy the parameters of equal shape, isi.pykeen.train_on"
            )
            raise InputError("argument 'model'", type(model).__name__, f"{problem}: {remedy}")
        tables.append(part)
    return tables


def relation_tables_of(model: PykeenModel) -> list[Table]:
    """The relation tables of a model; InputError if it has none,
    or computes vectors of relations.
    """
    parts = list(model.relation_representations)
    tables = [part for part in parts if isinstance(part, Table)]
    if not tables or len(tables) < len(parts):
        others = [type(part).__name__ for part in parts if not isinstance(part, Table)]
        problem = (
            f"{others[0]} computes the vectors of relations"
            if others
            else "it has no vectors of relations"
        )
        message = f"{type(model).__name__} cannot have new relations, since {problem}"
        raise InputError("argument 'new_relations'", "", message)
    return tables


def form_of(table: Table) -> Form:
    limits = tuple(limit for limit in (table.constrainer, table.normalizer) if limit is not None)
    return Form(tuple(table.shape), table.is_complex, limits)


def stored(tables: Sequence[Table], rows: Tensor) -> list[tuple[Table, Tensor]]:
    """Each of some tables, and its part of joined rows, (n, d), as PyKEEN stores it."""
    parts = parted(rows, list(map(form_of, tables)))
    real = [torch.view_as_real(values) if values.is_complex() else values for values in parts]
    return [
        (table, values.reshape(-1, table._embeddings.embedding_dim).to(table._embeddings.weight))
        for table, values in zip(tables, real, strict=True)
    ]


def read_model(model: PykeenModel, triples: Tensor, margin: float | None) -> Embedding:
    """Read a model as a stack of one embedding; margin None:
    estimated from ``triples``, shape (T, 3).

    Of a model with inverse triples, row 2r is that of relation r and row 2r + 1 that of its
    inverse, as in PyKEEN.
    """
    model = unwrapped(model)
    forms = tuple(map(form_of, tables_of(model)))
    entity = torch.cat([_read(table)[1] for table in tables_of(model)], 1)
    read = [_read(representation) for representation in model.relation_representations]
    tables = [rows for _, rows in read]
    triples = both_ways(triples) if model.use_inverse_triples else triples
    interaction = copied(model.interaction).cpu().double().eval().requires_grad_(False)
    rows = torch.cat(tables, 1) if tables else torch.zeros(model.num_relations, 1)
    scored = InteractionModel(interaction, forms, tuple(form for form, _ in read), 0.0)
    closed = closed_form(scored, entity.shape[1]) if len(forms) == 1 else None
    if closed and (own_rows := model_rows(closed, rows)) is not None:
        embedding = Embedding(entity[None].float(), own_rows[None].float(), closed)
        margin = margin_of(embedding, triples, margin)
        return replace(embedding, model=with_margin(closed, margin))
    scored = replace(
        scored, offset=margin_of(Embedding(entity[None], rows[None], scored), triples, margin)
    )
    return Embedding(entity[None].float(), rows[None].float(), scored)


def loss_of(model: PykeenModel, read: Model) -> Loss | TrainingLoss | None:
    """The loss that a model was trained with, of the scores of ``read``; None for one that is not
    known here; its name if its settings are the usual ones.
    """
    loss = _loss_of(unwrapped(model).loss, read)
    return loss.name if loss and loss == loss_named(loss.name) else loss


def _loss_of(loss: Any, read: Model) -> TrainingLoss | None:
    added = -margin_in(read)  # what is added to PyKEEN's scores
    if isinstance(loss, LOGISTIC):
        return TrainingLoss("logistic", added)
    if isinstance(loss, losses.NSSALoss | losses.AdversarialBCEWithLogitsLoss):
        margin = added + getattr(loss, "margin", 0.0)
        return TrainingLoss("self-adversarial", margin, loss.inverse_softmax_temperature)
    if isinstance(loss, losses.CrossEntropyLoss) and not isinstance(loss, losses.InfoNCELoss):
        return TrainingLoss("softmax")
    if isinstance(loss, MARGIN):
        return TrainingLoss("margin", getattr(loss, "margin", None) or 1.0)
    return None


def margin_in(read: Model) -> float:
    """What a model that was read adds to PyKEEN's scores."""
    if isinstance(read, InteractionModel):
        return read.offset
    margin: float = getattr(read, "margin", 0.0)
    return margin


def closed_form(scored: InteractionModel, dimension: int) -> Model | None:
    """The registered model, with a margin of 0, whose scores and constraint are those of an
    interaction; None if there is none.

    Compared on random vectors, so that a user's own model counts, too.
    """
    generator = torch.Generator().manual_seed(0)
    for model in _without_margin():
        with suppress(InputError):  # of a dimension that the model cannot have
            shape = SAMPLES, model.width(dimension)
            head, tail = torch.randn(2, SAMPLES, dimension, generator=generator).double()
            relation = torch.randn(shape, generator=generator).double()
            rows = table_rows(model, relation)
            if rows.shape[1] != sum(form.size for form in scored.relations):
                continue
            expected = scored.score(head, rows, tail)
            if torch.allclose(model.score(head, relation, tail), expected):
                return with_constraint(model, scored, head)
    return None


def with_constraint(model: Model, scored: InteractionModel, rows: Tensor) -> Model | None:
    """A registered model that constrains entity vectors as an interaction does; None if it cannot.

    Compared on random rows, (n, d), of lengths below and above 1.
    """
    lengths = torch.logspace(-1, 1, len(rows), dtype=rows.dtype)
    rows = normalize(rows, dim=-1) * lengths[:, None]
    expected, models = scored.constrain(rows), [model]
    if isinstance(model, ConstrainedModel):
        models = [replace(model, constraint=name) for name in CONSTRAINTS]
    alike = (each for each in models if torch.allclose(each.constrain(rows), expected))
    return next(alike, None)


def with_margin(model: Any, margin: float) -> Model:
    """A distance model with another margin; another model as it is."""
    changed: Model = replace(model, margin=margin) if model.distance else model
    return changed


def _without_margin() -> Iterator[Model]:
    """The registered models with a margin of 0, squared and not, if they have these options."""
    for name, squared in product(MODELS.names(), (False, True)):
        kind: Any = MODELS.get(name)
        options = {"margin": 0.0, "squared": squared}
        values = {option.name: options.get(option.name) for option in fields(kind)}
        known = {option: value for option, value in values.items() if value is not None}
        with suppress(TypeError):  # of an option without a default
            yield kind(**{**kind.defaults, **known})


def table_rows(model: Model, relations: Tensor) -> Tensor:
    """Rows of relations of a model that was read, (q, w), as joined rows of tables:
    angles as |r| = 1.
    """
    return torch.cat([relations.cos(), relations.sin()], 1) if model.angles else relations


def model_rows(model: Model, relations: Tensor) -> Tensor | None:
    """Joined rows of relation tables as rows of a model that was read: the inverse of
    ``table_rows``; None for complex numbers of another length than 1.
    """
    if not model.angles:
        return relations
    real, imaginary = relations.chunk(2, 1)
    is_rotation = (torch.hypot(real, imaginary) - 1).abs().max() < ROUNDING
    return torch.atan2(imaginary, real) if is_rotation else None


def _read(representation: Representation) -> tuple[Form, Tensor]:
    """Form and all rows, shape (N, size), of a representation in evaluation mode
    (no dropout; normalized).
    """
    training = representation.training
    with torch.no_grad():
        values = representation.eval()().detach().cpu()
    representation.train(training)
    if isinstance(representation, Table):
        return form_of(representation), _flat(values)
    return Form(tuple(representation.shape), values.is_complex()), _flat(values)


def _flat(values: Tensor) -> Tensor:
    """Values of a table, (N, *shape), as rows, (N, size)."""
    flat = values.reshape(len(values), prod(values.shape[1:]))
    return torch.cat([flat.real, flat.imag], 1) if values.is_complex() else flat
