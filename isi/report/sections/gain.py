"""The parts of ISI's gain over Xavier: the centre of what is known, the entity's kind, and meaning beyond both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from isi.report import models as of
from isi.report.data import Results
from isi.report.models import BASELINE, isi, label
from isi.report.section import Content, of_each
from isi.report.sections.immediate import SCOPE
from isi.report.significance import Difference, by_seed, difference, signed
from isi.report.stats import HALVES, cells_of, ratios
from isi.report.tables import Column, Estimate, Table
from isi.report.words import WORDS, joined

SCOPES = ("all", "novel")
#: Points of MRR* that are shown as 0.0.
ZERO = 0.05
#: What each of these has that the one before it (at first, Xavier) has not; an initializer of ISI has the last.
_MEAN = "mean"
_STEPS = (("centre", _MEAN), ("kind", "kind_mean"))
_LAST = "meaning"
WHOLE = "all of it"
#: An initializer of ISI and the control that differs from it in one thing.
_TWINS = (("words", "es", "es_permuted"), ("words within a kind", "es", "es_permuted_kinds"))


@dataclass(frozen=True)
class Gain:
    """What one model has that another has not, in one scope and half of immediate MRR*, in points."""

    scope: str
    #: a column of runs
    half: str
    part: str
    first: str
    second: str
    #: first minus second
    points: Difference


def controls(results: Results) -> Iterator[Content]:
    """The same of every graph, with a description of each control; nothing where no control was run."""
    names = list(dict.fromkeys(name for one in results.standalone for name in of.controls(one.initializers)))
    if names:
        yield from of_each(results.standalone, lambda one: of_runs(one.immediate, one.initializers, names))


def of_runs(immediate: pd.DataFrame, initializers: Sequence[str], controls: Sequence[str]) -> Content:
    """Parts and shares of the gain."""
    gains, shares = parts(immediate, initializers), shares_of_the_gain(immediate, initializers)
    rows: dict[tuple[str, str, str, str], dict[Any, Any]] = {}
    for gain in gains:
        head = {SCOPE: gain.scope, "part": gain.part, "what has it": label(gain.first), "minus": label(gain.second)}
        row = rows.setdefault((gain.scope, gain.part, gain.first, gain.second), head)
        row[Column(HALVES[gain.half], form=signed)] = gain.points
    found = {(one.scope, one.half): one.points for one in gains if (one.first, one.second) == (_MEAN, BASELINE)}
    centre = [found.get(("novel", half)) for half in HALVES]
    numbers = {
        "names": controls, "shares": shares, "mean": _MEAN, "centre": centre if all(centre) else None,
        "sentences": [
            (scope, method, [composition(gains, scope, half, method) for half in HALVES])
            for scope in SCOPES for method in isi(initializers) if any(gain.scope == scope for gain in gains)
        ],
    }  # fmt: skip
    return Content(numbers, [Table.of("parts_of_the_gain", rows.values()), Table.of("shares_of_the_gain", shares)])


def steps(method: str, models: Sequence[str]) -> list[tuple[str, str, str]]:
    """From Xavier to one of ISI over the controls that were run: the part, who has it, and who has it not yet."""
    found, names, before = [], [], BASELINE
    for name, model in (*_STEPS, (_LAST, method)):
        names.append(name)
        if model in models:
            found.append((joined(names), model, before))
            names, before = [], model
    return found


def parts(immediate: pd.DataFrame, models: Sequence[str]) -> list[Gain]:
    """Every step towards each initializer of ISI, its whole gain, and its twins, scope by scope and half by half."""
    found = []
    pairs = [step for method in isi(models) for step in steps(method, models)]
    pairs += [(WHOLE, method, BASELINE) for method in isi(models)]
    pairs = [pair for pair in dict.fromkeys([*pairs, *_TWINS]) if {*pair[1:]} <= set(models)]  # Xavier may lack
    for scope, half in product(SCOPES, HALVES):
        cells = 100 * cells_of(immediate, models, scope, half)
        for part, first, second in pairs:
            points = difference(by_seed(cells[first], cells[second]))
            if points.seeds:
                found.append(Gain(scope, half, part, first, second, points))
    return found


def shares_of_the_gain(immediate: pd.DataFrame, models: Sequence[str]) -> list[dict[Any, Any]]:
    """Each control's share of each ISI initializer's gain, and the rest, of means by seed; none without Xavier.

    No share where ISI gains nothing.
    """
    rows = []
    for scope, half in product(SCOPES if BASELINE in models else (), HALVES):
        cells = 100 * cells_of(immediate, models, scope, half)
        for method, control in product(isi(models), of.controls(models)):
            three = cells[[BASELINE, method, control]].dropna()
            gain, other = (by_seed(three[name], three[BASELINE]) for name in (method, control))
            if len(gain):
                share = Estimate(np.nan)
                if gain.mean() >= ZERO:
                    share = Estimate(*(100 * ratios(other[None], gain[None])[0]).tolist())
                rows.append({
                    SCOPE: scope, Column("of", words=WORDS): HALVES[half], "ISI": label(method),
                    "gain over Xavier": difference(gain), "control": label(control),
                    "control's gain": difference(other), "share %": share,
                    "rest": difference(by_seed(three[method], three[control])),
                })  # fmt: skip
    return rows


def composition(gains: Sequence[Gain], scope: str, half: str, method: str) -> dict[str, Any] | None:
    """One gain over Xavier and its parts, with their shares where each adds to it; None where nothing compares."""
    own = [gain for gain in gains if (gain.scope, gain.half) == (scope, half)]
    whole = next(
        (gain.points for gain in own if (gain.first, gain.second, gain.part) == (method, BASELINE, WHOLE)), None
    )
    models = sorted({name for gain in own for name in (gain.first, gain.second)})
    made = [gain for step in steps(method, models) for gain in own if (gain.part, gain.first, gain.second) == step]
    if whole is None or not made:
        return None
    shared = whole.mean >= ZERO and min(gain.points.mean for gain in made) >= 0
    percent = [100 * gain.points.mean / whole.mean if shared else None for gain in made]
    return {"gain": whole.mean, "parts": list(zip(made, percent, strict=True)), "last": made[-1].points}
