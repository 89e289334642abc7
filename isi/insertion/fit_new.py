"""``isi.fit_new``: new rows learn alone, the others frozen; then, if asked, all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from isi.config import Seed, check
from isi.errors import InputError, short
from isi.graph.graph import HEAD, TAIL
from isi.graph.sessions import TRAIN, Session
from isi.insertion.arguments import Triple, argument, family_of, graph_of, names_of, stack_of_one, table, triples_of
from isi.models.finite import NotFinite
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.training.batches import Negatives, is_dense, training_data
from isi.training.trainer import Optimizer, train


def fit_new(
    entities: np.ndarray, relations: np.ndarray, triples: Sequence[Triple] | np.ndarray, *, new: int,
    family: str | Model, family_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None, relation_names: Sequence[str] | None = None,
    known_triples: Sequence[Triple] | np.ndarray | None = None, epochs: int = 100, all_epochs: int = 0,
    learning_rate: float = 0.04, weight_decay: float = 0.001, batch_size: int = 2048, ratio: int = 9, seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Train the last rows of a table of entities, the others frozen; then, if asked, all rows.

    Losses are logistic, negatives corrupted heads, tails and relations, and steps those of Adagrad, as in the pipeline.

    Args:
        entities: vectors of known entities, then of new ones, as ``insert`` gives them; shape (E + n, d).
        relations: shape (R, w).
        triples: of the new entities, with known ends or new ones.
        new: how many the new entities are.
        family: as for ``insert``, like ``family_options``.
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
    with argument("seed"):
        check(seed, Seed, "seed")
    given = table(entities, "entities")
    if not isinstance(new, int | np.integer) or isinstance(new, bool) or not 0 < new < len(given):
        raise InputError("argument 'new'", "", f"expected a number from 1 to {len(given) - 1}, got {short(new)}")
    kind = family_of(family, family_options, given)
    rows = table(relations, "relations", kind.width(given.shape[1]))
    names = names_of("entity_names", len(given), entity_names)
    labels = names_of("relation_names", len(rows), relation_names)
    own = triples_of(triples, "triples", names, labels)
    before = triples_of(known_triples if known_triples is not None else [], "known_triples", names, labels)
    _check(own, before, len(given) - new, epochs, all_epochs)
    settings = {"batch_size": batch_size, "learning_rate": learning_rate, "weight_decay": weight_decay,
                "new_rows_first": epochs, "max_epochs": epochs + all_epochs}  # fmt: skip
    optimizer = check(settings, Optimizer, "", Path("fit_new"))
    theta = stack_of_one(given, rows, kind)
    learned = _learned(theta, np.concatenate([own, before]), new, optimizer, ratio, seed)
    if not all_epochs:
        vectors = learned.entity[0, -new:].numpy().astype(given.dtype)
        return np.concatenate([given[:-new], vectors]), rows.copy()
    return learned.entity[0].numpy().astype(given.dtype), learned.relation[0].numpy().astype(rows.dtype)


def _check(triples: np.ndarray, known_triples: np.ndarray, known: int, epochs: int, all_epochs: int) -> None:
    """Refuse triples without a new entity, known ones with one, and to move all rows on new triples alone.

    Raises:
        InputError: naming the argument.
    """
    if not len(triples) or not (triples[:, [HEAD, TAIL]] >= known).any(1).all():
        raise InputError("argument 'triples'", "", "expected triples, each with a new entity")
    if (known_triples[:, [HEAD, TAIL]] >= known).any():
        raise InputError("argument 'known_triples'", "", "expected triples of known entities alone")
    for name, number in (("epochs", epochs), ("all_epochs", all_epochs)):
        with argument(name):
            check(number, Seed, name)
    if epochs + all_epochs < 1:
        raise InputError("argument 'epochs'", "", "expected at least one epoch")
    if all_epochs and not len(known_triples):
        expected = "expected 'known_triples' too: all rows would forget what they know"
        raise InputError("argument 'all_epochs'", "", expected)


def _learned(theta: Embedding, triples: np.ndarray, new: int, optimizer: Optimizer, ratio: int, seed: int) -> Embedding:
    graph, entities = graph_of(triples, theta), theta.entity.shape[1]
    everyone = torch.ones(1, entities, dtype=torch.bool)
    session = Session(graph, everyone, torch.full((1, len(triples)), TRAIN, dtype=torch.int8))
    mode = "expected" if is_dense(graph) else "sampled"
    negatives = check({"mode": mode, "ratio": ratio, "head_pool": "unseen"}, Negatives, "", Path("fit_new"))
    novel = torch.arange(entities - new, entities)[None]
    data = training_data(session, "fine-tuning", torch.tensor([[entities, new]]), negatives.head_pool, novel)
    try:
        return train(theta, data, negatives, optimizer, seed, _onward)
    except NotFinite as error:
        raise InputError("fit_new", "", error.problem) from error


def _onward(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:  # noqa: ARG001
    """Nobody leaves before the last epoch."""
    return torch.ones(len(models), dtype=torch.bool)
