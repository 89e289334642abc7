"""Choices of initializers for a home (``isi.home.choices``), made on hidden known entities."""

from dataclasses import replace

import numpy as np

from isi.home.inserted import Choice, Conditions
from isi.home.loaded import LoadedEmbedding
from isi.insertion.hidden import HoldOut
from isi.insertion.probability import fit_curves
from isi.insertion.selection import named, one_score, select
from isi.models.losses import loss_named
from isi.models.stack import usual_torch

#: Of the selection: a home gets many entities, one after another.
HARM = 0.005


@usual_torch()
def choose(base: LoadedEmbedding, conditions: Conditions) -> Choice:
    """What serves under some conditions best, and its curves; it takes some seconds."""
    number, words, warnings = conditions.facts, conditions.words, list[str]()
    test = hold_out(base, number, words)
    if conditions.initializer is None:
        method, selection = select(test, number > 0, words, harm=HARM)
        warnings = list(selection.warnings) if selection else []
    else:
        options = dict(conditions.options)
        method = named(conditions.initializer, options, base.model, len(base.entities))
        method = replace(method, trained_with=base.manifest.loss or "logistic")
    draws = replace(test, loss=method.trained_with).hide()
    return Choice(
        method.initializer.name,
        dict(method.options),
        method.why,
        loss_named(method.trained_with).name,
        warnings,
        None if draws is None else fit_curves(draws, method),
    )


def hold_out(base: LoadedEmbedding, number: int, words: bool) -> HoldOut:
    """The hold-out test with so many insert triples for each hidden entity."""
    return HoldOut(
        replace(base.embedding, model=one_score(base.model)),
        base.triples,
        np.array([number]),
        base.words if words else None,
        base.kind_ids,
        seed=0,
        loss=base.manifest.loss,
    )
