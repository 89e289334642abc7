"""``isi.fit_new``: training of the rows of new entities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from isi.config import Seed, check
from isi.errors import InputError, short
from isi.insertion import arguments
from isi.insertion.arguments import Names, TripleForms, stack_of_one, table
from isi.insertion.engine import trained_session
from isi.models.model import Model
from isi.models.stack import NotFinite, without_denormals
from isi.training.batches import Negatives, is_dense, training_data
from isi.training.trainer import Optimizer, train


@without_denormals()
def fit_new(
    entities: np.ndarray | torch.Tensor,
    relations: np.ndarray | torch.Tensor,
    triples: TripleForms,
    *,
    new: int,
    model: str | Model,
    model_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None,
    relation_names: Sequence[str] | None = None,
    known_triples: TripleForms | None = None,
    epochs: int = 100,
    all_epochs: int = 0,
    learning_rate: float = 0.04,
    weight_decay: float = 0.001,
    batch_size: int = 2048,
    ratio: int = 9,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Train the rows of new entities while all other rows are frozen;
    then, optionally, train all rows.

    Loss, negatives and optimizer are the pipeline's: logistic loss, corrupted heads, tails and
    relations, Adagrad.

    Args:
        entities: vectors of known, then of new entities, as ``insert`` returns them; shape
            (E + n, d).
        relations: shape (R, w).
        triples: triples of the new entities; the other end is known or new.
        new: number n of new entities, the last rows of ``entities``.
        model: see ``insert``; also ``model_options`` and ``relation_names``. ``entity_names``: all
            E + n names.
        known_triples: triples of known entities, which are trained on too; required if
            ``all_epochs`` > 0.
        epochs: number of epochs that change new rows only; ``all_epochs``: number of later epochs
            on both tables.
        learning_rate: step size of Adagrad; ``weight_decay`` · parameters is added to each
            gradient.
        batch_size: triples per update; ``ratio``: number of corrupted heads, of tails and of
            relations per triple.
        seed: root seed of batches and negatives.

    Returns:
        both tables. If ``all_epochs`` is 0, relations and known entities are returned unchanged.

    Raises:
        InputError: names the wrong argument and the expected value, or says that training diverged.

    Example:
        >>> import isi, numpy as np
        >>> entities = np.array([[1.0, 0.0], [0.0, 1.0], [0.1, 0.1]])  # the last one is new
        >>> relations = np.array([[1.0, 1.0]])
        >>> fitted, _ = isi.fit_new(entities, relations, [(2, 0, 0)], new=1, model="distmult")
        >>> bool((fitted[:2] == entities[:2]).all()), bool(fitted[2, 0] > fitted[2, 1])
        (True, True)
    """
    for name, value in (("seed", seed), ("epochs", epochs), ("all_epochs", all_epochs)):
        check(value, Seed, "", f"argument {name!r}")
    rows = table(entities, "entities")
    if not arguments.is_whole(new) or not 0 < new < len(rows):
        raise InputError(
            "argument 'new'",
            "",
            f"expected a whole number from 1 to {len(rows) - 1}, got {short(new)}",
        )
    names, known = Names("entity_names", len(rows), entity_names), len(rows) - int(new)
    given = arguments.checked_arguments(
        rows, relations, model, model_options, names, relation_names, known, triples, known_triples
    )
    for name, wrong, expected in (
        ("triples", not len(given.triples), "expected triples, each with a new entity"),
        ("epochs", epochs + all_epochs < 1, "expected at least one epoch"),
        (
            "all_epochs",
            all_epochs > 0 and not len(given.known_triples),
            "expected 'known_triples' too: without them the known rows would be forgotten",
        ),
    ):
        if wrong:
            raise InputError(f"argument {name!r}", "", expected)
    theta = stack_of_one(rows, given.relations, given.model)
    session = trained_session(np.concatenate([given.triples, given.known_triples]), theta)
    settings = {
        "batch_size": batch_size,
        "learning_rate": learning_rate,
        "weight_decay": weight_decay,
        "new_rows_first": epochs,
        "max_epochs": epochs + all_epochs,
    }
    sampling = {
        "mode": "expected" if is_dense(session.graph) else "sampled",
        "ratio": ratio,
        "head_pool": "unseen",
    }
    optimizer = check(settings, Optimizer, "", "fit_new")
    negatives = check(sampling, Negatives, "", "fit_new")
    novel = torch.arange(known, len(rows))[None]
    keys = torch.tensor([[len(rows), len(rows) - known]])
    data = training_data(session, "fine-tuning", keys, negatives.head_pool, novel)
    try:
        trained = train(theta, data, negatives, optimizer, seed)
    except NotFinite as error:
        raise InputError("fit_new", "", error.message) from error
    vectors = trained.entity[0].numpy().astype(rows.dtype)
    if not all_epochs:
        return np.concatenate([rows[:known], vectors[known:]]), given.relations.copy()
    return vectors, trained.relation[0].numpy().astype(given.relations.dtype)
