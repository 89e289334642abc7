"""Vectors of new entities without a copy of the table of known ones,
which may be a memory-mapped file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch

from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.initializers.api import InitResult
from isi.initializers.scale import fit_scale
from isi.insertion.api import run_engine
from isi.insertion.arguments import Triple, options_by_name
from isi.insertion.request import InsertRequest, KnownEmbedding, checked_request
from isi.insertion.selection import named
from isi.models.losses import Loss
from isi.models.model import Model
from isi.models.stack import usual_torch


@usual_torch()
def insert_rows(
    entities: np.ndarray,
    relations: np.ndarray,
    triples: Sequence[Triple] | np.ndarray,
    *,
    new: int,
    model: str | Model,
    model_options: Mapping[str, Any] | None = None,
    known_triples: Sequence[Triple] | np.ndarray | None = None,
    initializer: str = "map",
    options: Mapping[str, Any] | None = None,
    seed: int = 0,
    loss: Loss = "logistic",
) -> np.ndarray:
    """The vectors of new entities, shape (n, d),
    as ``isi.insert`` computes them from triples with known entities.

    A float32 table is not copied: ``np.load(file, mmap_mode="r")`` is read in a few passes from
    start to end, and otherwise only at the rows that the initializer needs. Memory beyond the table
    grows with E + K, not with E · d.

    Args:
        entities: vectors of the known entities, shape (E, d), float32 (other floats are copied to
            it).
        triples: ids, each with one new entity; ``new``: number n of new entities, whose ids are E,
            E + 1, ....
        loss: the loss of training; what it needs is fitted to ``known_triples``.
        initializer: one that needs no words or kinds; see ``isi.insert`` for all other arguments.

    Raises:
        InputError: names the wrong argument and the expected value.
    """
    known = KnownEmbedding(entities, relations, model, model_options, triples=known_triples)
    request = InsertRequest(
        triples=triples,
        new=new,
        initializer=initializer,
        options=options,
        seed=seed,
        trained_with=loss,
    )
    checked = checked_request(known, request)
    novel = checked.novel
    if (novel.triples[:, [HEAD, TAIL]] >= novel.known).all(1).any():
        expected = "expected one known end each: insert entities one after the other"
        raise InputError("argument 'triples'", "", expected)
    triples_known = torch.from_numpy(novel.known_triples)
    scale = fit_scale(novel.theta, triples_known, loss)
    checked = replace(checked, novel=replace(novel, scale=scale))
    given = options_by_name(options, "options")
    method = named(initializer, given, checked.model, novel.known)
    result = cast(InitResult, run_engine(checked, method))  # there is a new entity
    return result.vectors[0].numpy()
