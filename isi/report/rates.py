"""Table 2 at other fine-tuning rates."""

from __future__ import annotations

import pandas as pd

from isi.convergence import SCOPES
from isi.report.results import JOINT, Results
from isi.report.tables import Table, label


def convergence_by_rate(results: Results) -> Table:
    """Epochs to convergence at one size, by the factor on the fine-tuning rate (1: the main runs)."""
    cells = cells_by_rate(results)
    groups = cells.groupby(["scope", "model", "factor"])
    mean, deviation, never = (
        groups["epochs"].mean(), groups["epochs"].std(ddof=1), 100 * (1 - groups["converged"].mean())
    )  # fmt: skip
    lines = []
    for scope in (scope for scope in SCOPES if scope in set(cells["scope"])):
        for model in results.initializers:
            line: dict[str, object] = {"scope": scope, "initializer": label(model)}
            for factor in sorted(cells["factor"].unique()):
                key = (scope, model, factor)
                line |= {
                    f"×{factor:g}: mean": mean.get(key),
                    f"×{factor:g}: std": deviation.get(key),
                    f"×{factor:g}: unconverged %": never.get(key),
                }
            lines.append(line)
    rate = results.params.finetuning.learning_rate
    return Table(
        "convergence_by_rate",
        "Epochs to convergence at other fine-tuning rates",
        f"As Table 2, at |ξ| = {results.params.rates.size} alone, with multiples of the fine-tuning rate of {rate:g}.",
        pd.DataFrame(lines),
    )


def sentences(results: Results) -> list[str]:
    """The order of initializers in each scope, and whether it depends on the rate."""
    return [order_of_initializers(results, scope) for scope in SCOPES]


def cells_by_rate(results: Results) -> pd.DataFrame:
    """Epochs to convergence of each initializer, factor and cell."""
    main = results.runs[(results.runs["size"] == results.params.rates.size) & (results.runs["model"] != JOINT)]
    return results.converged(pd.concat([main.assign(factor=1.0), results.rates]), ["model", "factor"])


def order_of_initializers(results: Results, scope: str) -> str:
    """A sentence: the initializers in order of their mean epochs, and whether it depends on the rate."""
    cells = cells_by_rate(results)
    means = cells[cells["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    orders = {float(factor): _order(means[factor], results.initializers) for factor in means.index.unique("factor")}
    if not orders:
        return f"Scope {scope} has no queries here."
    if len(set(orders.values())) == 1:
        return f"In scope {scope} the order is the same at every rate, fewest epochs first: {orders[1.0]}."
    told = "; ".join(f"{order} at ×{factor:g}" for factor, order in sorted(orders.items()))
    return f"In scope {scope} the order depends on the rate, fewest epochs first: {told}."


def _order(means: pd.Series, models: list[str]) -> str:
    """Models by ascending mean, those of equal means joined by =."""
    groups: dict[float, list[str]] = {}
    for model in (model for model in models if model in means.index):
        groups.setdefault(float(means[model]), []).append(label(model))
    return ", ".join(" = ".join(groups[mean]) for mean in sorted(groups))


TABLES = (convergence_by_rate,)
