"""``isi.fit_new``: training of the rows of new entities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from isi.config import Seed, check, is_whole, plain_number
from isi.errors import InputError, short
from isi.graph.vocabulary import Vocabulary
from isi.initializers.scale import fit_scale
from isi.insertion import arguments
from isi.insertion.arguments import TripleForms, stack_of_one, table
from isi.insertion.engine import queries_of, trained_session
from isi.insertion.new_rows import NewRows, best_epochs
from isi.models.losses import Loss
from isi.models.model import Model
from isi.models.stack import Embedding, NotFinite, usual_torch
from isi.training.batches import Negatives, is_dense
from isi.training.trainer import Optimizer


@usual_torch()
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
    loss: Loss = "logistic",
    early_stopping: bool = True,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Train the rows of new entities while all other rows are frozen;
    then, optionally, train all rows.

    By default, the loss is the pipeline's: logistic loss, with corrupted heads, tails and
    relations. With ``softmax`` it is cross-entropy over all entities; with ``margin`` or
    ``self-adversarial``, logistic loss of scores whose slope and border are fitted to the known
    triples. Known triples, if given, hold new entities where they would be wrong answers: without
    them, nothing keeps new rows from outranking earlier answers. The optimizer is Adagrad.

    Args:
        entities: vectors of known, then of new entities, as ``insert`` returns them; shape
            (E + n, d).
        relations: shape (R, w).
        triples: triples of the new entities; the other end is known or new.
        new: number n of new entities, the last rows of ``entities``.
        model: see ``insert``; also ``model_options`` and ``relation_names``. ``entity_names``: all
            E + n names.
        known_triples: triples of known entities, which are trained on too; required if
            ``all_epochs`` > 0, and with any ``loss`` but the logistic one.
        epochs: largest number of epochs that change new rows only; ``all_epochs``: number of later
            epochs on both tables, not with ``softmax``.
        learning_rate: step size of Adagrad; ``weight_decay`` · parameters is added to each
            gradient.
        batch_size: triples per update; ``ratio``: number of corrupted heads, of tails and of
            relations per triple, except with ``softmax``.
        loss: the loss that the embedding was trained with (see ``insert``).
        early_stopping: choose the number of epochs, perhaps 0, by the ranks of held-out facts, one
            of each new entity that has at least three with known entities; then train on all. If no
            new entity has three, the number is 0: training on one or two facts makes vectors worse.
        seed: root seed of batches and negatives.

    Returns:
        both tables. If ``all_epochs`` is 0, relations and known entities are returned unchanged.

    Raises:
        InputError: names the wrong argument and the expected value, or says that training diverged.

    Example:
        >>> import isi, numpy as np
        >>> entities = np.array([[1.0, 0.0], [0.0, 1.0], [0.1, 0.1]])  # the last one is new
        >>> relations = np.array([[1.0, 1.0]])
        >>> how = {"model": "distmult", "early_stopping": False}
        >>> fitted, _ = isi.fit_new(entities, relations, [(2, 0, 0)], new=1, **how)
        >>> bool((fitted[:2] == entities[:2]).all()), bool(fitted[2, 0] > fitted[2, 1])
        (True, True)
    """
    seed = check(seed, Seed, "", "argument 'seed'")
    epochs = check(epochs, Seed, "", "argument 'epochs'")
    all_epochs = check(all_epochs, Seed, "", "argument 'all_epochs'")
    new = plain_number(new)
    check(loss, Loss, "", "argument 'loss'")  # type: ignore[arg-type]
    rows = table(entities, "entities")
    if not is_whole(new) or not 0 < new < len(rows):
        raise InputError(
            "argument 'new'",
            "",
            f"expected a whole number from 1 to {len(rows) - 1}, got {short(new)}",
        )
    names, known = Vocabulary("entity", entity_names, len(rows)), len(rows) - int(new)
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
        (
            "all_epochs",
            all_epochs > 0 and loss == "softmax",
            "expected 0 with the loss 'softmax': all rows are trained with other losses alone",
        ),
        (
            "known_triples",
            loss != "logistic" and not len(given.known_triples),
            f"expected known triples, which say what scores mean after training with {loss!r}",
        ),
    ):
        if wrong:
            raise InputError(f"argument {name!r}", "", expected)
    theta = stack_of_one(rows, given.relations, given.model)
    settings = {
        "batch_size": batch_size,
        "learning_rate": learning_rate,
        "weight_decay": weight_decay,
        "max_epochs": epochs + all_epochs,
    }
    dense = is_dense(trained_session(given.known_triples, theta).graph)
    mode = "expected" if dense else "sampled"
    sampling = {"mode": mode, "ratio": ratio, "head_pool": "unseen"}
    of_known = Embedding(theta.entity[:, :known], theta.relation, theta.model)
    triples_known = torch.from_numpy(given.known_triples)
    scale = fit_scale(of_known, triples_known, loss)
    trained = torch.ones(1, len(triples_known), dtype=torch.bool)
    new_rows = NewRows(
        theta,
        known,
        given.known_triples,
        scale,
        check(settings, Optimizer, "", "fit_new"),
        check(sampling, Negatives, "", "fit_new"),
        seed,
        queries_of(of_known, triples_known, trained, scale),
    )
    try:
        if early_stopping and epochs:
            epochs = best_epochs(new_rows, given.triples, epochs)
        if all_epochs:
            fitted = new_rows.fit_all(given.triples, epochs, all_epochs)
        else:
            fitted = new_rows.fit(given.triples, epochs)
    except NotFinite as error:
        raise InputError("fit_new", "", error.message) from error
    vectors = fitted.entity[0].numpy().astype(rows.dtype)
    if not all_epochs:
        return np.concatenate([rows[:known], vectors[known:]]), given.relations.copy()
    return vectors, fitted.relation[0].numpy().astype(given.relations.dtype)
