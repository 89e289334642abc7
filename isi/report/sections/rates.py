"""Table 2 at other fine-tuning rates: a part of the section on epochs to convergence."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from isi.evaluation.convergence import SCOPES
from isi.report import wording
from isi.report.models import label
from isi.report.section import Table
from isi.report.statistics import over_seeds

#: Factor on the fine-tuning rate of the main runs.
AS_CHOSEN = 1.0


def convergence_by_rate(cells: pd.DataFrame, initializers: Sequence[str], size: int, rate: float, most: int) -> Table:
    """Epochs to convergence at one size, by the factor on the fine-tuning rate.

    Args:
        cells: epochs to convergence of each initializer, factor and cell, those of the main runs among them.
        rate: of the main runs.
        most: epochs that a run which never gets there counts as.
    """
    by = ["scope", "model", "factor"]
    means = over_seeds(cells, by, {"epochs": "mean"}, scale=1)
    means["median"] = cells.groupby(by)["epochs"].median()
    means["unconverged %"] = 100 * (1 - cells.groupby(by)["converged"].mean())
    lines = []
    for scope in (scope for scope in SCOPES if scope in set(cells["scope"])):
        for model in initializers:
            line: dict[str, object] = {"scope": scope, "initializer": label(model)}
            for factor in sorted(cells["factor"].unique()):
                line |= {f"×{factor:g}: {column}": means[column].get((scope, model, factor)) for column in means}
            lines.append(line)
    return Table(
        "convergence_by_rate",
        "Table 2 at every fine-tuning rate",
        f"As Table 2, at |ξ| = {size} alone, with multiples of the fine-tuning rate of {rate:g}: mean with its "
        f"interval over seeds, median, and the share of runs that never get there, which count as {most}.",
        pd.DataFrame(lines),
    )


def order_of_initializers(cells: pd.DataFrame, initializers: Sequence[str], scope: str) -> str:
    """A sentence: the initializers in order of their mean epochs, and whether it depends on the rate."""
    means = cells[cells["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    orders = {float(factor): _order(means[factor], initializers) for factor in means.index.unique("factor")}
    if not orders:
        return f"Over {wording.SCOPES[scope]} nothing was asked."
    if len(set(orders.values())) == 1:
        only = next(iter(orders.values()))
        return f"Over {wording.SCOPES[scope]} the order is the same at every rate, fewest epochs first: {only}."
    told = "; ".join(f"{order} at ×{factor:g}" for factor, order in sorted(orders.items()))
    return f"Over {wording.SCOPES[scope]} the order depends on the rate, fewest epochs first: {told}."


def _order(means: pd.Series, models: Sequence[str]) -> str:
    """Models by ascending mean, those of equal means joined by =."""
    groups: dict[float, list[str]] = {}
    for model in (model for model in models if model in means.index):
        groups.setdefault(float(means[model]), []).append(label(model))
    return ", ".join(" = ".join(groups[mean]) for mean in sorted(groups))
