"""How soon fine-tuning converges: Figure 3b and Table 2 (section 6.2), and Table 2 at other rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from isi.evaluation.convergence import SCOPES as CONVERGENCE_SCOPES
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import Figure, by_epoch
from isi.report.models import contenders, isi, label
from isi.report.section import Content, of_each
from isi.report.sections.immediate import SCOPE
from isi.report.significance import difference
from isi.report.stats import epochs_summary, in_order, over_seeds
from isi.report.tables import Column, Table

#: Factor on the fine-tuning rate of the main runs.
AS_CHOSEN = 1.0


def convergence(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    return of_each(results.standalone, lambda experiment: of_experiment(results, experiment))


def of_experiment(results: Results, experiment: Experiment) -> Content:
    """Epochs to convergence, Figure 3b, Table 2, and Table 2 at other rates."""
    params, initializers, cells = results.params, experiment.finetuned, experiment.convergence
    size, margin = experiment.curve_size, params.convergence.margin
    numbers: dict[str, Any] = {
        "margin": 100 * margin, "most": params.finetuning.max_epochs, "tested": contenders(initializers),
        "epochs": stats.epochs(cells, initializers), "unconverged": stats.unconverged(cells, initializers),
        "medians": stats.by_scope(cells.groupby(["scope", "model"])["epochs"].median(), initializers),
        "size": size, "best": [], "rates": None,
    }  # fmt: skip
    shown: list[Table | Figure] = [
        table2("table2_convergence", cells, initializers, results.paper["convergence"]["epochs"]),
        by_size(cells, initializers),
    ]
    if size is not None:
        numbers["best"] = best_epochs(experiment.curves, initializers)
        shown.append(learning_curves("figure3b_curves", experiment.curves, initializers, margin))
    if results.rate_sweep and results.rate_sweep.experiment is experiment:
        swept = [name for name in initializers if name in params.rate_sweep.initializers]
        rates = rate_cells(experiment, params.rate_sweep.size, swept, results.rate_sweep.result)
        if swept:
            numbers["rates"] = {scope: orders(rates, swept, scope) for scope in CONVERGENCE_SCOPES}
            numbers |= {"rate_size": params.rate_sweep.size, "finetuning": params.finetuning}
            shown.append(by_rate(rates, swept))
    return Content(numbers, shown)


def learning_curves(name: str, runs: pd.DataFrame, initializers: Sequence[str], margin: float) -> Figure:
    """Figure 3b: MRR* by epoch of fine-tuning, of runs of one size."""
    return Figure(name, by_epoch(runs, initializers, ("all", "novel_heldout"), margin=margin))


def best_epochs(runs: pd.DataFrame, initializers: Sequence[str]) -> list[tuple[Any, ...]]:
    """Held-out MRR* of each of ISI at the best epoch of its mean and at the last: name, both, and the change."""
    cells = 100 * runs[runs["scope"] == "novel_heldout"].pivot_table("mrr_star", ["model", "epoch"], "seed")
    found = []
    for model in isi(name for name in initializers if name in cells.index.unique("model")):
        by_epoch = pd.DataFrame(cells.xs(model, level="model"))
        means, epochs = by_epoch.mean(axis=1), by_epoch.index.to_numpy()
        best, last = int(epochs[means.to_numpy().argmax()]), int(epochs.max())
        change = difference((by_epoch.loc[last] - by_epoch.loc[best]).dropna().to_numpy())
        found.append((model, means[best], best, means[last], last, change))
    return found


def table2(
    name: str, cells: pd.DataFrame, initializers: Sequence[str], paper: Mapping[str, Mapping[str, float]]
) -> Table:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    found = epochs_summary(cells, ["scope", "model"])
    return Table.of(name, [
        {"initializer": label(model)}
        | {Column(column, scope): found[column].get((scope, model)) for scope in CONVERGENCE_SCOPES
           for column in ("mean", "std", "median", "unconverged %")}
        | {Column(shown, "paper"): paper.get(model, {}).get(column)
           for column, shown in (("mean", "mean"), ("deviation", "std"))}
        for model in initializers
    ])  # fmt: skip


def by_size(cells: pd.DataFrame, initializers: Sequence[str]) -> Table:
    """Table 2 for each size, with the number of queries that decide it."""
    by = ["scope", "size", "model"]
    groups = cells.groupby(by)
    frame = epochs_summary(cells, by).drop(columns="std")
    frame = frame.assign(**{"triples queried": groups["queries"].mean(), "sets": groups.size()})
    frame = in_order(frame.reset_index(), by, initializers)
    return Table.of("convergence_by_size", frame.rename(columns={"model": "initializer", "scope": SCOPE}))


def rate_cells(experiment: Experiment, size: int, swept: Sequence[str], sweep: pd.DataFrame) -> pd.DataFrame:
    """Epochs to convergence at every factor on the fine-tuning rate, that of the main runs among them."""
    main = experiment.runs[(experiment.runs["size"] == size) & experiment.runs["model"].isin(swept)]
    runs = pd.concat([main.assign(factor=AS_CHOSEN), sweep[sweep["model"].isin(swept)]])
    return experiment.converged(runs, ["model", "factor"])


def by_rate(cells: pd.DataFrame, initializers: Sequence[str]) -> Table:
    """Epochs to convergence at one size, by the factor on the fine-tuning rate (see ``rate_cells``)."""
    by = ["scope", "model", "factor"]
    means = over_seeds(cells, by, {"epochs": "mean"}, scale=1)
    means["median"] = cells.groupby(by)["epochs"].median()
    means["unconverged %"] = 100 * (1 - cells.groupby(by)["converged"].mean())
    return Table.of("convergence_by_rate", [
        dict[Any, Any]({SCOPE: scope, "initializer": label(model)})
        | {Column(str(column), f"×{factor:g}"): means[column].get((scope, model, factor))
           for factor in sorted(cells["factor"].unique()) for column in means}
        for scope in CONVERGENCE_SCOPES if scope in set(cells["scope"]) for model in initializers
    ])  # fmt: skip


def orders(cells: pd.DataFrame, initializers: Sequence[str], scope: str) -> dict[float, str]:
    """The initializers in order of their mean epochs at each factor on the rate; those of equal means joined by =."""
    means = cells[cells["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    found = {}
    for factor in means.index.unique("factor"):
        groups: dict[float, list[str]] = {}
        for model in (model for model in initializers if model in means[factor].index):
            groups.setdefault(float(means[factor][model]), []).append(label(model))
        found[float(factor)] = ", ".join(" = ".join(groups[mean]) for mean in sorted(groups))
    return found
