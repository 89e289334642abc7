"""What the size of the indicator set does to ES, RS and ERS (section 5.3, Figures 2a and 2b)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from isi.convergence import SCOPES
from isi.report.figures import Figure, colour_of, intervals, legend, panels
from isi.report.results import ISI, Results
from isi.report.tables import Table, label
from isi.selection import select_size

#: Marks of the sizes that someone chose: marker, how it is filled, and its size.
_MARKS = {"this run": ("s", "full", 5), "paper": ("D", "none", 9), "picked by the rule": ("*", "full", 11)}


def immediate_sensitivity(results: Results) -> Figure:
    """Figure 2a: immediate MRR* against the size of the indicator set."""
    at_once = results.sweep[results.sweep["epoch"] == 0]
    rows = at_once.assign(value=100 * at_once["mrr_star"])
    return Figure(
        "figure2a_immediate_sensitivity",
        "Figure 2a. Immediate MRR* against the indicator set size",
        f"MRR* right after insertion of {results.params.sweep.size} entities, mean and 95 % interval over "
        f"{results.params.sweep.seeds} seeds: over all queries (left, the paper's figure) and over the queries about "
        "the novel entities (right).",
        _drawn(results, rows, ("all", "novel"), "MRR* (points)"),
    )


def convergence_sensitivity(results: Results) -> Figure:
    """Figure 2b: epochs to convergence against the size of the indicator set."""
    rows = results.sweep_convergence.rename(columns={"epochs": "value"})
    most = results.params.finetuning.max_epochs
    return Figure(
        "figure2b_convergence_sensitivity",
        "Figure 2b. Epochs to convergence against the indicator set size",
        f"Epochs until Θ¹ with {results.params.sweep.size} entities inserted has converged, mean and 95 % interval "
        f"over {results.params.sweep.seeds} seeds: over all queries (left, the paper's figure) and over held-out "
        f"queries about the novel entities (right). Runs that never get there count as {most}: one of them moves a "
        f"mean by up to {most / results.params.sweep.seeds:g}.",
        _drawn(results, rows, SCOPES, "epochs to convergence", lowest=0),
    )


def indicator_sizes(results: Results) -> Table:
    """The indicator set size that the paper's rule picks, beside those of this run and of the paper."""
    chosen, means = _chosen(results), _means(results)
    lines = []
    for model in ISI:
        own = means.loc[model]
        best = own["novel: MRR*"].idxmax() if own["novel: MRR*"].notna().any() else None
        lines.append(
            {"initializer": label(model), **{who: sizes[model] for who, sizes in chosen.items()}}
            | {
                "picked: MRR*": own["novel: MRR*"][chosen["picked by the rule"][model]],
                "picked: epochs": own["novel_heldout: epochs"][chosen["picked by the rule"][model]],
                "best MRR*": own["novel: MRR*"].max(),
                "best at": best,
            }
        )
    return Table(
        "indicator_sizes",
        "Indicator set sizes",
        "The size that params use, the paper's, and the one that the paper's rule picks from this run: grow the set "
        "while the mean number of epochs over three neighbouring sizes still falls by at least 1, and stop where MRR* "
        "falls 1 point below the best. It is applied to immediate MRR* (points) in scope novel and to epochs to "
        "convergence in scope novel_heldout, means over seeds, since in scope all there is next to nothing left to "
        "converge.",
        pd.DataFrame(lines),
    )


def sensitivity(results: Results) -> Table:
    """The numbers behind Figures 2a and 2b."""
    frame = _means(results).reset_index()
    frame["model"] = frame["model"].map(label)
    return Table(
        "sensitivity",
        "Sensitivity to the indicator set size",
        "Immediate MRR* (points), epochs to convergence and the share of runs that never converge, means over seeds.",
        frame.rename(columns={"model": "initializer", "k": "indicators"}),
    )


def picked_sizes(results: Results) -> dict[str, int]:
    """What the paper's rule picks for each initializer."""
    means = _means(results)
    return {
        model: select_size(
            means.loc[model].index.tolist(),
            (means.loc[model]["novel: MRR*"] / 100).tolist(),
            means.loc[model]["novel_heldout: epochs"].tolist(),
        )
        for model in ISI
    }


def best_sizes(results: Results) -> dict[str, int]:
    """The size of the best immediate MRR* in scope all, for each initializer."""
    means = _means(results)["all: MRR*"]
    return {model: int(means.loc[model].dropna().idxmax()) for model in ISI if means.loc[model].notna().any()}


def _means(results: Results) -> pd.DataFrame:
    """Means over seeds by model and k, models in their order."""
    at_once = results.sweep[results.sweep["epoch"] == 0]
    mrr_star = 100 * at_once.groupby(["model", "k", "scope"])["mrr_star"].mean().unstack("scope")
    cells = results.sweep_convergence.groupby(["model", "k", "scope"])
    epochs = cells["epochs"].mean().unstack("scope").reindex(columns=SCOPES)
    never = 100 * (1 - cells["converged"].mean()).unstack("scope").reindex(columns=SCOPES)
    columns = {f"{scope}: MRR*": mrr_star[scope] for scope in ("all", "novel")}
    for scope in SCOPES:
        columns |= {f"{scope}: epochs": epochs[scope], f"{scope}: unconverged %": never[scope]}
    return pd.DataFrame(columns, index=mrr_star.index, dtype=float).loc[list(ISI)]


def _chosen(results: Results) -> dict[str, dict[str, int]]:
    """Indicator set sizes by who chose them and model."""
    ours = {model: getattr(results.params.initializers, model).k for model in ISI}
    return {"this run": ours, "paper": results.paper["indicators"], "picked by the rule": picked_sizes(results)}


def _drawn(
    results: Results, rows: pd.DataFrame, scopes: tuple[str, ...], measure: str, lowest: float | None = None
) -> Canvas:
    """Means and intervals of ``value`` by k, a panel for each scope, with the sizes that were chosen."""
    canvas, axes = panels(len(scopes))
    chosen = _chosen(results)
    for panel, scope in zip(axes, scopes, strict=True):
        for model in ISI:
            own = rows[(rows["model"] == model) & (rows["scope"] == scope)]
            if len(own):
                _draw(panel, own, colour_of(results, model), label(model))
                _mark(panel, own, colour_of(results, model), {who: sizes[model] for who, sizes in chosen.items()})
        panel.set(title=f"scope {scope}", xlabel="indicators k", ylabel=measure)
        panel.set_ylim(bottom=lowest)
    for who, (marker, fill, size) in _MARKS.items():
        axes[0].plot([], [], color="#555555", ls="", marker=marker, fillstyle=fill, ms=size, label=who)
    legend(canvas, axes[0])
    return canvas


def _draw(axes: Axes, rows: pd.DataFrame, colour: str, name: str) -> None:
    line = intervals(rows["value"], rows["k"])
    axes.plot(line.index, line["mean"], color=colour, label=name, lw=1.4)
    axes.fill_between(line.index, line["low"], line["high"], color=colour, alpha=0.15, lw=0)


def _mark(axes: Axes, rows: pd.DataFrame, colour: str, chosen: dict[str, int]) -> None:
    """Mark the sizes that were chosen on the line of means; those beyond it have no mark."""
    line = rows.groupby("k")["value"].mean()
    for who, k in chosen.items():
        marker, fill, size = _MARKS[who]
        height = np.interp(k, line.index, line, left=np.nan, right=np.nan)
        axes.plot(k, height, color=colour, ls="", marker=marker, fillstyle=fill, ms=size, clip_on=False)


TABLES = (indicator_sizes, sensitivity)
FIGURES = (immediate_sensitivity, convergence_sensitivity)
