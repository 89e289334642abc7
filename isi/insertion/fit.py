"""``isi.fit_new``: the name before ``Inserted.train``."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from isi.config import is_whole, plain_number
from isi.errors import InputError, short
from isi.insertion.api import insert
from isi.insertion.arguments import TripleForms, table
from isi.insertion.result import with_vectors
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model
from isi.renamed import warn_of

#: Arguments of before that have no effect now.
GONE = ("weight_decay", "batch_size", "ratio", "early_stopping", "learning_rate", "all_epochs")


def fit_new(
    entities: np.ndarray | torch.Tensor,
    relations: np.ndarray | torch.Tensor,
    triples: TripleForms,
    *,
    new: int,
    model: str | Model,
    epochs: int = 5,
    loss: Loss | TrainingLoss = "logistic",
    **settings: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Both tables after training of the last ``new`` rows of ``entities`` on their triples:
    use ``isi.insert(...).train(epochs)``.

    Args:
        entities: known, then new entities, (E + n, d); further arguments are those of
            ``isi.insert``, with names of all entities.

    Example:
        >>> import isi, numpy as np
        >>> entities = np.array([[1.0, 0.0], [0.0, 1.0], [0.1, 0.1]])  # the last one is new
        >>> relations = np.array([[1.0, 1.0]])
        >>> fitted, _ = isi.fit_new(entities, relations, [(2, 0, 0)], new=1, model="distmult")
        >>> bool((fitted[:2] == entities[:2]).all()), bool(fitted[2, 0] > fitted[2, 1])
        (True, True)
    """
    gone = [name for name in GONE if settings.pop(name, None)]
    without = f"; {', '.join(gone)} has no effect" if gone else ""
    warn_of("isi.fit_new", f"isi.insert(...).train(epochs=5){without}")
    return trained_rows(
        entities, relations, triples, new=new, model=model, epochs=epochs, loss=loss, **settings
    )


def trained_rows(
    entities: np.ndarray | torch.Tensor,
    relations: np.ndarray | torch.Tensor,
    triples: TripleForms,
    *,
    new: int,
    model: str | Model,
    epochs: int,
    loss: Loss | TrainingLoss,
    **settings: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """What ``fit_new`` returns."""
    rows, new = table(entities, "entities"), plain_number(new)
    if not is_whole(new) or not 0 < new < len(rows):
        expected = f"expected a whole number from 1 to {len(rows) - 1}, got {short(new)}"
        raise InputError("argument 'new'", "", expected)
    names: Any = settings.pop("entity_names", None)
    added: Any = new
    if names is not None:
        names, added = list(names)[:-new], list(names)[-new:]
    done = insert(
        rows[:-new],
        relations,
        triples,
        new=added,
        model=model,
        entity_names=names,
        initializer="mean",
        trained_with=loss,
        **settings,
    )
    trained = with_vectors(done, rows[-new:]).train(epochs)
    return trained.entities, trained.relations
