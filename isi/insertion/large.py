"""Vectors of new entities without a copy of the table of known ones,
which may be a memory-mapped file.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from isi.config import Seed, check
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.insertion import arguments
from isi.insertion.api import batches, choose, in_order_of_ids, init_context_of
from isi.insertion.arguments import Names, Triple, argument, stack_of_one, table
from isi.models.model import Model
from isi.models.stack import NotFinite, without_denormals


@without_denormals()
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
        initializer: one that needs no words or kinds; see ``isi.insert`` for all other arguments.

    Raises:
        InputError: names the wrong argument and the expected value.
    """
    check(seed, Seed, "", "argument 'seed'")
    rows = table(entities, "entities")
    known = rows.shape[-2]
    names = arguments.all_names(Names("entity_names", known, None), new, "new")
    if names.number == known:
        raise InputError("argument 'new'", "", "expected at least one new entity")
    given = arguments.checked_arguments(
        rows, relations, model, model_options, names, None, known, triples, known_triples
    )
    if (given.triples[:, [HEAD, TAIL]] >= known).all(1).any():
        raise InputError(
            "argument 'triples'",
            "",
            "expected one known end each: insert entities one after the other",
        )
    # of torch: such a file is not writable
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        theta0 = stack_of_one(rows, given.relations, given.model)
    chosen, used, _, together = choose(initializer, options, theta0, len(given.triples) > 0, False)
    parts = batches(
        torch.arange(known, names.number), given.triples, together, max(given.relations.shape)
    )
    results = []
    try:
        for part in parts:
            context = init_context_of(
                theta0, part, known, given.triples, given.known_triples, None, None, seed
            )
            # a row of the table, without words
            context = replace(context, novel=torch.zeros_like(part)[None])
            with argument("initializer"):
                results.append(chosen.initialize(context, used))
    except NotFinite as error:
        raise InputError(
            "argument 'entities'", "", f"expected other known vectors: {error.message}"
        ) from error
    return in_order_of_ids(results, torch.cat(parts)).vectors[0].numpy()
