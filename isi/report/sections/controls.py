"""What ISI's gain over Xavier is made of: how much of it each control already has, and what remains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pandas as pd

from isi.report.models import BASELINE, controls, described, isi, label
from isi.report.results import Experiment, Results
from isi.report.section import Bullets, Content, Section, Table, by_experiment

SCOPES = ("all", "novel")
#: Points of MRR* that are shown as 0.0.
NOTHING = 0.05


@dataclass(frozen=True)
class Share:
    """What one control has of one ISI initializer's gain over Xavier in immediate MRR*, in points."""

    scope: str
    method: str
    gain: float
    control: str
    control_gain: float

    @property
    def percent(self) -> float:
        """The control's share of the gain; null where there is no gain to share."""
        return 100 * self.control_gain / self.gain if self.gain >= NOTHING else np.nan

    @property
    def rest(self) -> float:
        """What the initializer has beyond the control."""
        return self.gain - self.control_gain


def contents(results: Results) -> Iterator[Content]:
    """What each control is, then its shares on every graph; nothing where no control was run."""
    run = dict.fromkeys(name for one in results.own for name in controls(one.initializers))
    if not run:
        return
    yield (
        "The gap between ISI and Xavier mixes several things: known vectors have a centre and a spread of their own, "
        "and Xavier has neither. Controls take these apart."
    )
    yield Bullets([described(name) for name in run])
    yield from by_experiment(results, of_experiment)


def of_experiment(_results: Results, experiment: Experiment) -> Iterator[Content]:
    """Shares in words and as a table."""
    found = shares(experiment.at_once, experiment.initializers)
    if found:
        yield Bullets(sentences(found))
        yield shares_of_the_gain(found)
    else:
        yield "Without Xavier, one of ISI and a control there is no gain to take apart."


def shares(at_once: pd.DataFrame, initializers: Sequence[str]) -> list[Share]:
    """Of means over all sizes and seeds; empty where Xavier was not run."""
    points = 100 * at_once.groupby(["scope", "model"])["mrr_star"].mean().dropna()
    gains = {
        (scope, model): float(points[scope, model] - points[scope, BASELINE])
        for scope in SCOPES
        for model in initializers
        if (scope, model) in points.index and (scope, BASELINE) in points.index
    }
    return [
        Share(scope, method, gains[scope, method], control, gains[scope, control])
        for scope in SCOPES
        for method in isi(initializers)
        for control in controls(initializers)
        if (scope, method) in gains and (scope, control) in gains
    ]


def shares_of_the_gain(found: Sequence[Share]) -> Table:
    """Each control's share of each ISI initializer's gain, and the rest."""
    columns = {
        "scope": str, "ISI": str, "gain over Xavier": float, "control": str, "control's gain": float,
        "share %": float, "rest": float,
    }  # fmt: skip
    rows = [
        (one.scope, label(one.method), one.gain, label(one.control), one.control_gain, one.percent, one.rest)
        for one in found
    ]
    return Table(
        "shares_of_the_gain",
        "Shares of the gain",
        "Gains over Xavier in immediate MRR* (points), means over all sizes and seeds; the share of ISI's gain that a "
        "control already has, and the rest in points. No share where ISI gains nothing; a share is negative where the "
        "control is below Xavier, and the rest where it is above ISI.",
        pd.DataFrame(rows, columns=list(columns)).astype(columns),
        folded=True,
    )


def sentences(found: Sequence[Share]) -> list[str]:
    """The same in words: one for each scope and ISI initializer."""
    return [sentence(list(group)) for _, group in groupby(found, key=lambda one: (one.scope, one.method))]


def sentence(group: list[Share]) -> str:
    """What the controls have of one gain, and what the best of them leaves for semantics."""
    first = group[0]
    who = f"In scope {first.scope}, {label(first.method)}"
    if first.gain < NOTHING:
        below = f": it is {-first.gain:.1f} points below" if first.gain <= -NOTHING else ""
        return f"{who} gains nothing over Xavier{below}, so there is nothing to share."
    parts = "; ".join(f"{label(one.control)} {_has(one)}" for one in group)
    best = min(group, key=lambda one: one.rest)
    if best.rest >= NOTHING:
        left = f"beyond the best of them, {label(best.control)}, {best.rest:.1f} points remain for semantics"
    elif best.rest > -NOTHING:
        left = f"nothing remains for semantics: {label(best.control)} has as much"
    else:
        left = f"nothing remains for semantics: {label(best.control)} is {-best.rest:.1f} points ahead"
    return f"{who} gains {first.gain:.1f} points over Xavier. Of these {parts}; {left}."


def _has(one: Share) -> str:
    if one.control_gain <= -NOTHING:
        return f"has none, being {-one.control_gain:.1f} points below Xavier"
    if one.control_gain < NOTHING:
        return "has none"
    return f"has {one.percent:.0f} %"


SECTION = Section("controls", "What the gain is made of", contents)
