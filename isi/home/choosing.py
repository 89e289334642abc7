"""Choices of initializers for a home (``isi.home.choices``), made on hidden known entities."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from isi.home.inserted import Choice, Key
from isi.home.loaded import LoadedEmbedding
from isi.initializers.api import INITIALIZERS
from isi.insertion.engine import Method
from isi.insertion.hidden import HoldOut
from isi.insertion.probability import fit_curves
from isi.insertion.selection import defaults_of, named, one_score, select
from isi.models.losses import loss_named
from isi.models.stack import usual_torch

#: Of the selection: a home gets many entities, one after another.
HARM = 0.005
#: Of new entities' part in earlier facts, where fold-in inserts into a home that was trained here:
#: known triples lose least (docs/command.md).
SHARE = 3.0


@usual_torch()
def choose(base: LoadedEmbedding, key: Key, selected: Choice | None = None) -> Choice:
    """The choice for a key, with its curves; it takes some seconds.

    ``selected``: one for names with words, or for fewer facts, whose initializer serves here, too;
    None: one is selected, unless the key names it.
    """
    facts, has_words, requested = key
    test = hold_out(base, facts, has_words)
    method, warnings = None, list[str]()
    if requested:
        name, *options = json.loads(requested)
        method = named(name, dict(options), base.model, len(base.entities))
        method = replace(method, trained_with=base.manifest.loss or "logistic")
    elif facts and base.manifest.inserted_curves is not None:
        why = "the default of a home that was trained here"
        return Choice("fold_in", fold_in_options(has_words), why, "softmax", (), None)
    elif selected is not None:
        method = _as_selected(base, selected, has_words)
    if method is None:
        method, selection = select(test, facts > 0, has_words, harm=HARM)
        warnings = list(selection.warnings) if selection else []
    draws = replace(test, loss=method.trained_with).hide()
    return Choice(
        method.initializer.name,
        dict(method.options),
        method.why,
        loss_named(method.trained_with).name,
        warnings,
        None if draws is None else fit_curves(draws, method),
    )


def fold_in_options(has_words: bool) -> dict[str, Any]:
    """The options of fold-in in a home that was trained here."""
    return {**defaults_of(INITIALIZERS.get("fold_in"), has_words), "share": SHARE}


def _as_selected(base: LoadedEmbedding, selected: Choice, has_words: bool) -> Method | None:
    """The method of a choice; None if it needs words and there are none."""
    registered, options = INITIALIZERS.get(selected.initializer), dict(selected.options)
    if not has_words:
        if "words" in registered.needs:
            return None
        if (start := registered.starts_from) is not None:
            options[start] = registered.defaults[start]
    method = named(selected.initializer, options, base.model, len(base.entities))
    loss = base.manifest.loss or selected.trained_with
    return replace(method, why=selected.why, trained_with=loss)


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
