"""``isi.pykeen.insert``: a model and a triples factory of PyKEEN's, enlarged by new entities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from pykeen.models import ERModel
from pykeen.nn.representation import Embedding as Table
from pykeen.triples import CoreTriplesFactory, TriplesFactory
from torch import Tensor
from torch.optim import Optimizer

from isi.config import check
from isi.errors import InputError, short
from isi.insertion import api
from isi.insertion.arguments import Triple, as_list
from isi.insertion.result import Inserted
from isi.insertion.words import Source
from isi.pykeen.models import Form, read_model, table_of

Model = ERModel[Any, Any, Any]
Margin = Annotated[float, Field(allow_inf_nan=False)]


def insert(
    model: Model, factory: CoreTriplesFactory, triples: Sequence[Triple] | np.ndarray | Tensor, **arguments: Any
) -> tuple[Model, CoreTriplesFactory]:
    """Put new entities into a trained model; its other vectors stay as they are.

    Args:
        model: with one vector for each entity. TransE (either norm, squared or not), DistMult, ComplEx and RotatE take
            any initializer; others take those that need no inverse of a relation (mean, es, soft_es, map_mean, ...).
        factory: that it was trained on.
        triples: of the new entities; as labels where the factory has them, else as ids.
        arguments: see ``inserted``.

    Returns:
        copies: a model with rows for the new entities behind those that it has, and a factory with their labels and
        triples behind those that it has, ready for prediction, evaluation, further training and saving.

    Raises:
        InputError: naming the argument that is wrong, and what was expected.
    """
    return enlarge(model, factory, inserted(model, factory, triples, **arguments))


def inserted(
    model: Model, factory: CoreTriplesFactory, triples: Sequence[Triple] | np.ndarray | Tensor, *,
    new: int | Sequence[str] | None = None, words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, margin: float | None = None,
    seed: int = 0,
) -> Inserted:  # fmt: skip
    """The vectors of new entities and their report, as ``isi.insert`` gives them; see there for the arguments.

    Args:
        new: labels of the new entities, those that the triples bring where there are none; or how many they are, where
            the factory has no labels.
        margin: from which distance on a triple counts as wrong; read off the scores of the factory's triples where
            there is none.
    """
    rows: Any = triples.cpu().numpy() if isinstance(triples, Tensor) else triples
    rows = rows if isinstance(rows, np.ndarray) and rows.ndim else as_list(rows, "triples", "triples")
    check(margin, Margin | None, "", Path("argument 'margin'"))  # type: ignore[arg-type]
    _check_fit(model, factory)
    embedding = read_model(model, factory.mapped_triples, margin)
    entity_names, relation_names = _labels(factory)
    return api.insert(
        embedding.entity[0].numpy(), embedding.relation[0].numpy(), rows,
        new=_new(factory, rows) if new is None else new, model=embedding.model,
        entity_names=entity_names, relation_names=relation_names,
        known_triples=factory.mapped_triples.numpy(), words=words, word_source=word_source, kinds=kinds,
        initializer=initializer, options=options, seed=seed,
    )  # fmt: skip


def _check_fit(model: Model, factory: CoreTriplesFactory) -> None:
    """See that a factory is one, and of as many entities and relations as a model.

    Raises:
        InputError: where it is not.
    """
    if not isinstance(factory, CoreTriplesFactory):
        raise InputError("argument 'factory'", "", f"expected a triples factory of PyKEEN's, got {short(factory)}")
    expected, got = (
        f"{entities} entities and {relations} relations"
        for entities, relations in (
            (table_of(model).max_id, model.num_real_relations), (factory.num_entities, factory.real_num_relations)
        )
    )  # fmt: skip
    if got != expected:
        raise InputError("argument 'factory'", "", f"expected {expected}, as the model has, got {got}")


def enlarge(model: Model, factory: CoreTriplesFactory, done: Inserted) -> tuple[Model, CoreTriplesFactory]:
    """Copies of a model and of its factory with what was inserted."""
    larger = deepcopy(model)
    larger.num_entities = len(done.entities)
    _append(table_of(larger), torch.from_numpy(done.entities[done.known :]))
    return larger, _factory(factory, done)


def warm(optimizer: Optimizer) -> Optimizer:
    """The same optimizer, made such that PyKEEN's ``train(..., continue_training=True)`` takes it.

    Without ``continue_training``, PyKEEN's training loops begin with new random vectors, whatever a model knows; with
    it, they ask for an optimizer that has been used.
    """
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            optimizer.state[parameter]  # an entry, which is empty until the first step
    return optimizer


def _append(table: Table, rows: Tensor) -> None:
    """Put rows behind those of a table, constrained as it constrains its own."""
    values = Form(tuple(table.shape), table.is_complex).values(rows)
    if table.constrainer is not None:
        values = table.constrainer(values)
    if table.is_complex:
        values = torch.view_as_real(values)
    weight = table._embeddings.weight
    new = values.reshape(len(values), -1).to(weight)
    weight.data, weight.grad = torch.cat([weight.data, new]), None  # the parameter stays, which regularizers may watch
    table.max_id = table._embeddings.num_embeddings = len(weight)


def _factory(factory: CoreTriplesFactory, done: Inserted) -> CoreTriplesFactory:
    new = torch.from_numpy(np.concatenate([done.insert_triples, done.between]))
    triples = torch.cat([factory.mapped_triples, new])
    if isinstance(factory, TriplesFactory):
        names = done.entity_names or []
        labels = dict(factory.entity_to_id) | {names[row]: row for row in done.new}
        return TriplesFactory(triples, labels, factory.relation_to_id, metadata=dict(factory.metadata))
    number = len(done.entities)
    return CoreTriplesFactory(triples, number, factory.real_num_relations, metadata=dict(factory.metadata))


def _new(factory: CoreTriplesFactory, triples: Any) -> list[str]:
    """Labels that the triples bring, in their order.

    Raises:
        InputError: where the factory has no labels.
    """
    if not isinstance(factory, TriplesFactory):
        raise InputError("argument 'new'", "", "expected how many entities are new: the factory has no labels")
    whole = [tuple(triple) for triple in triples if hasattr(triple, "__len__") and len(triple) == 3]
    ends = [end for triple in whole for end in triple[::2] if isinstance(end, str)]
    return [str(end) for end in dict.fromkeys(ends) if end not in factory.entity_to_id]


def _labels(factory: CoreTriplesFactory) -> tuple[list[str] | None, list[str] | None]:
    """Labels of entities and of relations, if there are any."""
    if not isinstance(factory, TriplesFactory):
        return None, None
    entities = _by_id(factory.entity_to_id, factory.num_entities)
    return entities, _by_id(factory.relation_to_id, factory.num_relations)


def _by_id(ids: Mapping[str, int], number: int) -> list[str]:
    """Labels in the order of ids.

    Raises:
        InputError: where some ids have none.
    """
    labels = {row: label for label, row in ids.items()}
    if len(labels) != number:
        raise InputError("argument 'factory'", "", f"expected labels of all {number} rows, got {len(labels)}")
    return [labels[row] for row in range(number)]
