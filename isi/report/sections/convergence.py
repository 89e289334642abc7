"""How soon fine-tuning converges: Figure 3b and Table 2 (section 6.2), and Table 2 at other rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from isi.evaluation.query_sets import CONVERGING
from isi.report.data import Experiment, Results
from isi.report.figures import by_epoch
from isi.report.section import Content, of_each_graph
from isi.report.significance import difference
from isi.report.stats import epochs_summary, ordered_rows, over_seeds, wide
from isi.report.tables import Column
from isi.report.words import SCOPE, isi, label

#: Factor on the fine-tuning rate of the main runs.
AS_CHOSEN = 1.0
#: Of Figure 3b.
CURVES = ("all", "novel_heldout")


@of_each_graph
def convergence(results: Results, experiment: Experiment) -> Content:
    """Epochs to convergence, Figure 3b, Table 2, and Table 2 at other rates."""
    params, initializers, epochs = results.params, experiment.finetuned, experiment.convergence
    size, margin, sweep = experiment.curve_size, params.convergence.margin, params.rate_sweep
    numbers: dict[str, Any] = {"best": [], "rates": None}
    tables: dict[str, Any] = {
        "table2_convergence": table2(epochs, initializers, results.paper["convergence"]["epochs"]),
        "convergence_by_size": _by_size(epochs, initializers),
    }
    figures = {}
    if size is not None:
        numbers["best"] = best_epochs(experiment.curves, initializers)
        figures["figure3b_curves"] = by_epoch(experiment.curves, initializers, CURVES, margin=margin)
    swept = [name for name in initializers if name in sweep.initializers]
    if "rate_sweep" in experiment.analyses and swept:
        runs, rates = experiment.runs, experiment.analyses["rate_sweep"]
        main = runs[(runs["size"] == sweep.size) & runs["model"].isin(swept)].assign(factor=AS_CHOSEN)
        by_factor = experiment.converged(pd.concat([main, rates[rates["model"].isin(swept)]]), ["model", "factor"])
        numbers["rates"] = {scope: orders(by_factor, swept, scope) for scope in CONVERGING}
        tables["convergence_by_rate"] = by_rate(by_factor, swept)
    return Content(numbers, tables, figures)


def best_epochs(runs: pd.DataFrame, initializers: Sequence[str]) -> list[tuple[Any, ...]]:
    """Held-out MRR* of each of ISI at the best epoch of its mean and at the last: name, both, and the change."""
    heldout, lines = runs[runs["scope"] == "novel_heldout"], []
    for model in isi(initializers):
        by_epoch = 100 * heldout[heldout["model"] == model].pivot_table("mrr_star", "epoch", "seed")
        if len(by_epoch):
            means = by_epoch.mean(axis=1)
            best, last = int(by_epoch.index.to_numpy()[means.to_numpy().argmax()]), int(by_epoch.index.max())
            change = difference((by_epoch.loc[last] - by_epoch.loc[best]).dropna().to_numpy())
            lines.append((model, means[best], best, means[last], last, change))
    return lines


def table2(
    epochs: pd.DataFrame, initializers: Sequence[str], paper: Mapping[str, Mapping[str, float]]
) -> dict[Any, list[Any]]:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    summary = epochs_summary(epochs, ["scope", "model"])[["mean", "std", "median", "unconverged %"]]
    ours = wide(summary, [(model,) for model in initializers], {scope: scope for scope in CONVERGING})
    theirs: dict[Any, list[Any]] = {
        Column(title, "paper"): [paper.get(model, {}).get(column) for model in initializers]
        for column, title in (("mean", "mean"), ("deviation", "std"))
    }
    return {"initializer": list(map(label, initializers))} | ours | theirs


def _by_size(epochs: pd.DataFrame, initializers: Sequence[str]) -> pd.DataFrame:
    """Table 2 for each size, with the number of queries that decide it."""
    by = ["scope", "size", "model"]
    groups = epochs.groupby(by)
    frame = epochs_summary(epochs, by).drop(columns="std")
    frame = frame.assign(**{"triples queried": groups["queries"].mean(), "sets": groups.size()})
    titles: dict[Any, Any] = {"model": "initializer", "scope": SCOPE}
    return ordered_rows(frame, initializers).rename(columns=titles)


def by_rate(epochs: pd.DataFrame, initializers: Sequence[str]) -> dict[Any, list[Any]]:
    """Epochs to convergence at one size, by the factor on the fine-tuning rate."""
    by = ["factor", "scope", "model"]
    groups = epochs.groupby(by)
    summary = over_seeds(epochs, by, {"epochs": "mean"}, scale=1)
    summary["median"] = groups["epochs"].median()
    summary["unconverged %"] = 100 * (1 - groups["converged"].mean())
    rows = [(scope, model) for scope in CONVERGING if scope in set(epochs["scope"]) for model in initializers]
    titles = {factor: f"×{factor:g}" for factor in sorted(epochs["factor"].unique())}
    keys: dict[Any, list[Any]] = {SCOPE: [scope for scope, _ in rows], "initializer": [label(row[1]) for row in rows]}
    return keys | wide(summary, rows, titles)


def orders(epochs: pd.DataFrame, initializers: Sequence[str], scope: str) -> dict[float, str]:
    """The initializers in order of their mean epochs at each factor on the rate; those of equal means joined by =."""
    means = epochs[epochs["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    lines = {}
    for factor in means.index.unique("factor"):
        listed = pd.Series({label(model): means[factor][model] for model in initializers if model in means[factor]})
        lines[float(factor)] = ", ".join(" = ".join(listed.index[listed == mean]) for mean in sorted(set(listed)))
    return lines
