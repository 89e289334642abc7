"""Training of a model of PyKEEN that has new entities: of the new rows alone, or of all rows."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from pykeen.optimizers import optimizer_resolver
from pykeen.pipeline import PipelineResult
from pykeen.training import training_loop_resolver
from pykeen.triples import CoreTriplesFactory
from torch.optim import Optimizer

from isi.config import Count, as_list, check, is_whole, plain_number
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.graph.vocabulary import Vocabulary
from isi.insertion import fit
from isi.insertion.arguments import naming_argument, triples_of
from isi.insertion.inverses import pack
from isi.models.losses import Loss
from isi.models.stack import usual_torch
from isi.pykeen.insertion import labelled, of_result, vocabularies_of
from isi.pykeen.reading import PykeenModel, copied, loss_of, read_model, stored, tables_of


@usual_torch()
def fit_new(
    model: PykeenModel | PipelineResult,
    factory: Any = None,
    triples: Any = None,
    *,
    new: int | Sequence[str | int] | None = None,
    epochs: int = 100,
    learning_rate: float = 0.04,
    weight_decay: float = 0.001,
    batch_size: int = 2048,
    ratio: int = 9,
    margin: float | None = None,
    loss: Loss | None = None,
    early_stopping: bool = True,
    seed: int = 0,
) -> PykeenModel:
    """Train the vectors of new entities in a copy of an enlarged model, by ``isi.fit_new``.
    All else stays unchanged.

    Args:
        model: with new entities, as ``insert`` returns it; ``factory``: its triples factory, with
            their triples.
        triples: of the new entities, in any form that ``insert`` accepts. Without ``new``, those
            entities in them are new that have no other triple in the factory.
        new: labels or ids of the entities to train, or the number of the last ones. They are
            trained on their triples in ``factory`` and ``triples``.
        margin: see ``insert``; the other arguments are those of ``isi.fit_new``, whose known
            triples are all others in ``factory``.
        loss: None: that of the model, or logistic loss if it has none of ``isi.models.losses``.

    Returns:
        a copy of the model.

    Raises:
        InputError: names the wrong argument and the expected value, or says that training diverged.

    Example:
        >>> larger, more = isi.pykeen.insert(model, factory, [("mug", "in", "kitchen")])
        >>> how = {"epochs": 2, "early_stopping": False}
        >>> fitted = isi.pykeen.fit_new(larger, more, [("mug", "in", "kitchen")], **how)
        >>> fitted.num_entities
        5
    """
    model, factory, triples = of_result(model, factory, triples)
    tables_of(model)
    names, relations = vocabularies_of(model, factory)
    with naming_argument("triples"):
        added = triples_of(
            [] if triples is None else labelled(triples), "triples", names, relations
        )
    known = factory.mapped_triples.numpy()
    ids = _new_ids(names, new, added, known)
    order = np.concatenate([np.setdiff1d(np.arange(names.number), ids), ids])  # new ones last
    every = np.unique(np.concatenate([known, added]), axis=0)
    about = np.isin(every[:, [HEAD, TAIL]], ids).any(1)
    every[:, [HEAD, TAIL]] = np.argsort(order)[every[:, [HEAD, TAIL]]]
    embedding = read_model(model, factory.mapped_triples, margin)
    if loss is None:
        loss = loss_of(model, embedding.model) or "logistic"
    embedding = pack(embedding) if model.use_inverse_triples else embedding
    vectors, _ = fit.fit_new(
        embedding.entity[0].numpy()[order],
        embedding.relation[0].numpy(),
        every[about],
        new=len(ids),
        model=embedding.model,
        known_triples=every[~about],
        epochs=epochs,
        learning_rate=learning_rate,
        weight_decay=weight_decay,
        batch_size=batch_size,
        ratio=ratio,
        loss=loss,
        early_stopping=early_stopping,
        seed=seed,
    )
    trained = copied(model)
    for table, rows in stored(tables_of(trained), torch.from_numpy(vectors[-len(ids) :])):
        table._embeddings.weight.data[torch.from_numpy(ids)] = rows
    return trained


def _new_ids(
    names: Vocabulary, new: int | Sequence[str | int] | None, triples: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Sorted ids of the entities to train; by default those that are in ``triples`` and
    in no other known triple.
    """
    new = plain_number(new)
    if new is None:
        others = set(map(tuple, known.tolist())) - set(map(tuple, triples.tolist()))
        ends = np.unique(triples[:, [HEAD, TAIL]])
        ids = np.setdiff1d(ends, [end for head, _, tail in others for end in (head, tail)]).astype(
            np.int64
        )
    elif is_whole(new):
        ids = np.arange(names.number)[max(0, names.number - int(new)) :]  # type: ignore[arg-type]
    else:
        with naming_argument("new"):
            ids = np.unique([names.id(label, "") for label in as_list(new)]).astype(np.int64)
    if not 0 < len(ids) < names.number:
        raise InputError(
            "argument 'new'", "", "expected at least one new entity, beside known ones"
        )
    return ids


def train_on(
    model: PykeenModel | PipelineResult,
    factory: CoreTriplesFactory | None = None,
    epochs: int = 5,
    *,
    training_loop: str = "slcwa",
    optimizer: str | Optimizer = "adam",
    learning_rate: float = 0.001,
    batch_size: int = 256,
    progress: bool = False,
) -> list[float]:
    """Continue PyKEEN's training of all vectors of a model, in place, without new random vectors.

    Args:
        model: with or without new entities; ``factory``: its triples factory.
        epochs: number of epochs, with the loss and the regularizers of the model.
        training_loop: slcwa (sampled negatives) or lcwa.
        optimizer: a name, with step size ``learning_rate``, or an optimizer of the model's
            parameters.

    Returns:
        the mean loss of each epoch.

    Example:
        >>> larger, more = isi.pykeen.insert(model, factory, [("mug", "in", "kitchen")])
        >>> len(isi.pykeen.train_on(larger, more, epochs=2))
        2
    """
    epochs = check(epochs, Count, "", "argument 'epochs'")
    batch_size = check(batch_size, Count, "", "argument 'batch_size'")
    model, factory, _ = of_result(model, factory, ())
    vocabularies_of(model, factory)
    if not isinstance(optimizer, Optimizer):
        optimizer = optimizer_resolver.make(
            optimizer, {"lr": learning_rate}, params=model.get_grad_params()
        )
    loop = training_loop_resolver.make(
        training_loop, model=model, triples_factory=factory, optimizer=warm(optimizer)
    )
    losses = loop.train(
        factory,
        epochs,
        batch_size,
        continue_training=True,
        use_tqdm=progress,
        use_tqdm_batch=progress,
        pin_memory=False,
    )
    return losses or []


def warm(optimizer: Optimizer) -> Optimizer:
    """Prepare an optimizer, in place, for PyKEEN's ``train(continue_training=True)``,
    which does not reset vectors.

    Example:
        >>> from torch.optim import Adam
        >>> len(isi.pykeen.warm(Adam(model.get_grad_params())).state)
        2
    """
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            # creates an empty entry; PyKEEN refuses an optimizer without state
            optimizer.state[parameter]
    return optimizer
