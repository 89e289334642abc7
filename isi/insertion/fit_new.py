"""``isi.fit_new``: new rows are trained, the others frozen; then, if so chosen, all rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from isi.config import Seed, check
from isi.errors import InputError, short
from isi.graph.sessions import TRAIN, Session
from isi.insertion.arguments import Triple, checked_arguments, graph_of, names_of, renamed, stack_of_one, table
from isi.models.model import Model
from isi.models.stack import Embedding, NotFinite
from isi.training.batches import Negatives, is_dense, training_data
from isi.training.trainer import Optimizer, train


@renamed(family="model", family_options="model_options")
def fit_new(
    entities: np.ndarray, relations: np.ndarray, triples: Sequence[Triple] | np.ndarray, *, new: int,
    model: str | Model, model_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None, relation_names: Sequence[str] | None = None,
    known_triples: Sequence[Triple] | np.ndarray | None = None, epochs: int = 100, all_epochs: int = 0,
    learning_rate: float = 0.04, weight_decay: float = 0.001, batch_size: int = 2048, ratio: int = 9, seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Train the last rows of a table of entities, the others frozen; then, if so chosen, all rows.

    Losses are logistic, negatives corrupted heads, tails and relations, and steps those of Adagrad, as in the pipeline.

    Args:
        entities: vectors of known entities, then of new ones, as ``insert`` gives them; shape (E + n, d).
        relations: shape (R, w).
        triples: of the new entities, with known ends or new ones.
        new: how many the new entities are.
        model: as for ``insert``, like ``model_options``.
        entity_names: of known and new ones; as ``relation_names`` of relations.
        known_triples: of the known entities, to learn from beside; without them all rows may not move.
        epochs: in which the new rows alone move.
        all_epochs: in which all rows of both tables move after that.
        learning_rate: of Adagrad.
        weight_decay: of every update.
        batch_size: triples in one update.
        ratio: corrupted heads, tails and relations each, to a triple.
        seed: of batches and negatives.

    Returns:
        both tables. Without ``all_epochs`` the rows of relations and known entities are the bytes that were given.

    Raises:
        InputError: naming the argument that is wrong, and what was expected.
    """
    for name, value in (("seed", seed), ("epochs", epochs), ("all_epochs", all_epochs)):
        check(value, Seed, "", Path(f"argument {name!r}"))
    rows = table(entities, "entities")
    if not isinstance(new, int | np.integer) or isinstance(new, bool) or not 0 < new < len(rows):
        raise InputError("argument 'new'", "", f"expected a number from 1 to {len(rows) - 1}, got {short(new)}")
    names, known = names_of("entity_names", len(rows), entity_names), len(rows) - int(new)
    given = checked_arguments(
        rows, relations, model, model_options, names, relation_names, known, triples, known_triples
    )
    if not len(given.triples):
        raise InputError("argument 'triples'", "", "expected triples, each with a new entity")
    if epochs + all_epochs < 1:
        raise InputError("argument 'epochs'", "", "expected at least one epoch")
    if all_epochs and not len(given.known_triples):
        expected = "expected 'known_triples' too: all rows would forget what they know"
        raise InputError("argument 'all_epochs'", "", expected)
    settings = {"batch_size": batch_size, "learning_rate": learning_rate, "weight_decay": weight_decay,
                "new_rows_first": epochs, "max_epochs": epochs + all_epochs}  # fmt: skip
    optimizer = check(settings, Optimizer, "", Path("fit_new"))
    theta = stack_of_one(given.entities, given.relations, given.model)
    trained = _trained(theta, np.concatenate([given.triples, given.known_triples]), known, optimizer, ratio, seed)
    vectors = trained.entity[0].numpy().astype(rows.dtype)
    if not all_epochs:
        return np.concatenate([rows[:known], vectors[known:]]), given.relations.copy()
    return vectors, trained.relation[0].numpy().astype(given.relations.dtype)


def _trained(
    theta: Embedding, triples: np.ndarray, known: int, optimizer: Optimizer, ratio: int, seed: int
) -> Embedding:
    graph, entities = graph_of(triples, theta), theta.entity.shape[1]
    everyone = torch.ones(1, entities, dtype=torch.bool)
    session = Session(graph, everyone, torch.full((1, len(triples)), TRAIN, dtype=torch.int8))
    mode = "expected" if is_dense(graph) else "sampled"
    negatives = check({"mode": mode, "ratio": ratio, "head_pool": "unseen"}, Negatives, "", Path("fit_new"))
    novel, keys = torch.arange(known, entities)[None], torch.tensor([[entities, entities - known]])
    data = training_data(session, "fine-tuning", keys, negatives.head_pool, novel)
    try:
        return train(theta, data, negatives, optimizer, seed, _until_the_last_epoch)
    except NotFinite as error:
        raise InputError("fit_new", "", error.message) from error


def _until_the_last_epoch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:  # noqa: ARG001
    return torch.ones(len(models), dtype=torch.bool)
