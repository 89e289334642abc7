"""What ISI's gain over Xavier is made of: how much of it each control already has, and what remains."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pandas as pd

from isi.report.results import Results
from isi.report.tables import CONTROLS, ISI, Table, label

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


def shares(results: Results) -> list[Share]:
    """Of means over all sizes and seeds; empty where Xavier was not run."""
    points = 100 * results.at_once.groupby(["scope", "model"])["mrr_star"].mean().dropna()
    gains = {
        (scope, model): float(points[scope, model] - points[scope, "xavier"])
        for scope in SCOPES
        for model in results.initializers
        if (scope, model) in points.index and (scope, "xavier") in points.index
    }
    return [
        Share(scope, method, gains[scope, method], control, gains[scope, control])
        for scope in SCOPES
        for method in ISI
        for control in CONTROLS
        if (scope, method) in gains and (scope, control) in gains
    ]


def shares_of_the_gain(results: Results) -> Table:
    """Each control's share of each ISI initializer's gain, and the rest."""
    columns = {
        "scope": str, "ISI": str, "gain over Xavier": float, "control": str, "control's gain": float,
        "share %": float, "rest": float,
    }  # fmt: skip
    rows = [
        (one.scope, label(one.method), one.gain, label(one.control), one.control_gain, one.percent, one.rest)
        for one in shares(results)
    ]
    return Table(
        "shares_of_the_gain",
        "Shares of the gain",
        "Gains over Xavier in immediate MRR* (points), means over all sizes and seeds; the share of ISI's gain that a "
        "control already has, and the rest in points. No share where ISI gains nothing; a share is negative where the "
        "control is below Xavier, and the rest where it is above ISI.",
        pd.DataFrame(rows, columns=list(columns)).astype(columns),
    )


def sentences(results: Results) -> list[str]:
    """The same in words: one for each scope and ISI initializer."""
    return [sentence(list(group)) for _, group in groupby(shares(results), key=lambda one: (one.scope, one.method))]


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


TABLES = (shares_of_the_gain,)
