"""Functions of earlier versions, which still work, with a warning."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from pykeen.pipeline import PipelineResult
from pykeen.triples import CoreTriplesFactory

from isi.config import as_list, is_whole, plain_number
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.graph.vocabulary import Vocabulary
from isi.insertion.arguments import naming_argument, triples_of
from isi.insertion.fit import GONE, trained_rows
from isi.insertion.inverses import pack
from isi.insertion.result import Inserted
from isi.models.losses import Loss, TrainingLoss
from isi.models.stack import usual_torch
from isi.pykeen.insertion import EnlargedModel, insert, labelled, of_result, vocabularies_of
from isi.pykeen.reading import PykeenModel, copied, loss_of, read_model, stored, tables_of
from isi.renamed import warn_of


def compute_rows(*arguments: Any, **settings: Any) -> Inserted:
    """``isi.pykeen.insert(...).rows``."""
    warn_of("isi.pykeen.compute_rows(...)", "isi.pykeen.insert(...).rows")
    return insert(*arguments, **settings).rows


def enlarge(
    model: PykeenModel, factory: CoreTriplesFactory, done: Inserted
) -> tuple[PykeenModel, CoreTriplesFactory]:
    """``model`` and ``factory`` of the result of ``isi.pykeen.insert``."""
    warn_of("isi.pykeen.enlarge(...)", "model, factory = isi.pykeen.insert(...)")
    enlarged = EnlargedModel(done, (model, factory))
    return enlarged.model, enlarged.factory


@usual_torch()
def fit_new(
    model: PykeenModel | PipelineResult,
    factory: Any = None,
    triples: Any = None,
    *,
    new: int | Sequence[str | int] | None = None,
    epochs: int = 5,
    margin: float | None = None,
    loss: Loss | TrainingLoss | None = None,
    **settings: Any,
) -> PykeenModel:
    """A copy of an enlarged model in which the rows of ``new`` entities are trained on their
    triples in ``factory`` and ``triples``: use ``isi.pykeen.insert(...).train(epochs)``.

    Args:
        new: labels or ids, or the number of the last ones. None: those in ``triples`` that have no
            other triple in the factory.
        settings: those of ``isi.fit_new``.
    """
    warn_of("isi.pykeen.fit_new(...)", "isi.pykeen.insert(...).train(epochs=5).model", 4)
    model, factory, triples = of_result(model, factory, triples)
    tables_of(model)
    names, relations = vocabularies_of(model, factory)
    with naming_argument("triples"):
        listed = [] if triples is None else labelled(triples)
        added = triples_of(listed, "triples", names, relations)
    known = factory.mapped_triples.numpy()
    ids = _new_ids(names, new, added, known)
    order = np.concatenate([np.setdiff1d(np.arange(names.number), ids), ids])  # new ones last
    every = np.unique(np.concatenate([known, added]), axis=0)
    about = np.isin(every[:, [HEAD, TAIL]], ids).any(1)
    every[:, [HEAD, TAIL]] = np.argsort(order)[every[:, [HEAD, TAIL]]]
    read = read_model(model, factory.mapped_triples, margin)
    embedding = pack(read) if model.use_inverse_triples else read
    vectors, _ = trained_rows(
        embedding.entity[0].numpy()[order],
        embedding.relation[0].numpy(),
        every[about],
        new=len(ids),
        model=embedding.model,
        epochs=epochs,
        loss=loss or loss_of(model, read.model) or "logistic",
        known_triples=every[~about],
        **{name: value for name, value in settings.items() if name not in GONE},
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
