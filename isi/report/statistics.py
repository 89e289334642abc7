"""Means over runs, in points of MRR*, and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

from isi.report.models import BASELINE, label

HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity half", "mrr_star_relation": "relation half"}
#: Scope by scope, each model's value.
ByScope = dict[str, dict[str, float]]


def mrr_star(runs: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Mean MRR* in points, of those that were asked anything."""
    return by_scope(100 * runs.groupby(["scope", "model"])["mrr_star"].mean().dropna(), models)


def epochs(convergence: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Mean epochs to convergence."""
    return by_scope(convergence.groupby(["scope", "model"])["epochs"].mean(), models)


def unconverged(convergence: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Share of runs that never converge, in per cent."""
    return by_scope(100 * (1 - convergence.groupby(["scope", "model"])["converged"].mean()), models)


def by_scope(values: pd.Series, models: Sequence[str]) -> ByScope:
    """Values by (scope, model) as mappings, models in their order."""
    return {
        str(scope): {model: float(values[scope, model]) for model in models if (scope, model) in values.index}
        for scope in values.index.unique("scope")
    }


def improvement(at_once: pd.DataFrame, scope: str) -> dict[str, float]:
    """Of each model over Xavier, in per cent: the ratio of means at each size, averaged over sizes (section 6.1).

    Empty where Xavier was not run.
    """
    shown = at_once[at_once["scope"] == scope]
    means = shown.groupby(["size", "model"])["mrr_star"].mean().unstack()
    if BASELINE not in means:
        return {}
    gain = (100 * (means.div(means[BASELINE], axis=0) - 1)).mean().dropna()
    return {str(model): float(value) for model, value in gain.items()}


def fewer_epochs(convergence: pd.DataFrame, scope: str = "all") -> dict[str, float]:
    """By how much each initializer's mean number of epochs is below Xavier's, in per cent (section 6.2)."""
    means = convergence[convergence["scope"] == scope].groupby("model")["epochs"].mean()
    if BASELINE not in means or not means[BASELINE]:
        return {}
    return {str(model): float(value) for model, value in (100 * (1 - means / means[BASELINE])).items()}


def halves_by_model(runs: pd.DataFrame, models: Sequence[str], scopes: Sequence[str]) -> pd.DataFrame:
    """A row for each model: mean MRR* in points with its entity and its relation half, scope by scope."""
    means = 100 * runs.groupby(["model", "scope"])[list(HALVES)].mean()
    lines = [
        {"model": label(model)}
        | {
            f"{scope}: {name}": means[column].get((model, scope), np.nan)
            for scope in scopes
            for column, name in HALVES.items()
        }
        for model in models
    ]
    return pd.DataFrame(lines)


def in_order(frame: pd.DataFrame, by: Sequence[str], models: Sequence[str]) -> pd.DataFrame:
    """Rows sorted by columns, the last of which is ``model``: in the models' order, with their labels."""
    ordered = frame.assign(model=frame["model"].astype(pd.CategoricalDtype(list(models), ordered=True)))
    ordered = ordered.sort_values(list(by)).astype({"model": str})
    return ordered.assign(model=ordered["model"].map(label)).reset_index(drop=True)


def intervals(values: pd.Series, by: pd.Series) -> pd.DataFrame:
    """Mean and 95 % interval (Student's t) of the values of each group; without spread where there is one.

    Args:
        values: one a seed; null ones are left out.
        by: group of each.

    Returns:
        columns mean, low and high, by group.
    """
    groups = values.groupby(by)
    mean, number = groups.mean(), groups.count()
    reach = stats.t.ppf(0.975, (number - 1).clip(lower=1)) * groups.sem(ddof=1).where(number != 1, 0.0)
    return pd.DataFrame({"mean": mean, "low": mean - reach, "high": mean + reach})
