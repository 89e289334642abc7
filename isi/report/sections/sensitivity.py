"""What the size of the indicator set does (section 5.3, Figures 2a and 2b)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from isi.evaluation.convergence import SCOPES
from isi.report.figures import legend, panels
from isi.report.models import colour, label
from isi.report.prose import listed
from isi.report.results import Results, Study
from isi.report.section import Content, Figure, Section, Table
from isi.report.selection import select_size
from isi.report.statistics import HIGH, LOW, over_seeds

#: Indicator set sizes by who chose them and initializer.
Chosen = Mapping[str, Mapping[str, int]]
#: Marks of the sizes that someone chose: marker, how it is filled, and its size.
_MARKS = {"this run": ("s", "full", 5), "paper": ("D", "none", 9), "picked by the rule": ("*", "full", 11)}


def contents(results: Results) -> Iterator[Content]:
    """What was chosen in words, Figures 2a and 2b, and their numbers."""
    if results.sweep is None:
        return
    how, (at_once, cells) = results.params.sweep, measured(results.sweep)
    models = list(how.initializers)
    found = means(at_once, cells, models)
    chosen = chosen_sizes(found, results.params.initializers, results.paper["indicators"])
    sizes = {who: listed(of_each, models, "{:d}") for who, of_each in chosen.items()}
    yield (
        f"Indicators that the paper's rule picks from this run: {sizes['picked by the rule']}. All other results here "
        f"are with {sizes['this run']}; the paper's: {sizes['paper']}."
    )
    most = results.params.finetuning.max_epochs
    yield Figure(
        "figure2a_immediate_sensitivity",
        "Figure 2a. Immediate MRR* against the indicator set size",
        f"MRR* right after insertion of {how.size} entities, less that with the size that all other results have, "
        f"paired by seed: mean and 95 % interval over {how.seeds} seeds, over all queries (left, the paper's figure, "
        "which has MRR* itself) and over the queries about the novel entities (right). Scales differ.",
        drawn(
            relative(at_once, chosen["this run"]),
            models,
            chosen,
            (
                ("all", "all queries", "MRR* less that with this run's k (points)"),
                ("novel", "novel entities", ""),
            ),
        ),
    )
    yield Figure(
        "figure2b_convergence_sensitivity",
        "Figure 2b. Convergence against the indicator set size",
        f"With {how.size} entities inserted, mean and 95 % interval over {how.seeds} seeds. Left: the share of runs "
        "that are not within the margin at once, over all queries, where there is next to nothing to converge (the "
        "paper's figure has epochs). Right: epochs to convergence over held-out queries about the novel entities. "
        f"Runs that never get there count as {most}: one of them moves a mean by up to {most / how.seeds:g}.",
        drawn(convergence(cells), models, chosen, (
            ("all", "all queries: not at once", "share of runs (%)"),
            ("novel_heldout", "novel entities, held out", "epochs to convergence"),
        ), lowest=0),
    )  # fmt: skip
    yield indicator_sizes(found, chosen)
    yield sensitivity(found)


def measured(sweep: Study[pd.DataFrame]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs right after insertion, and epochs to convergence, of each initializer, indicator set size and cell."""
    runs = sweep.found
    return runs[runs["epoch"] == 0], sweep.experiment.converged(runs, ["model", "k"])


def relative(at_once: pd.DataFrame, reference: Mapping[str, int]) -> pd.DataFrame:
    """Runs with MRR* (points) less that of the same initializer and cell with its reference size, as ``value``.

    A size that was not swept is replaced by the nearest that was.
    """
    parts = []
    for model, own in at_once.groupby("model"):
        swept = own["k"].unique()
        k = swept[np.abs(swept - reference.get(str(model), swept.min())).argmin()]
        cell = ["scope", "size", "seed"]
        base = own[own["k"] == k].set_index(cell)["mrr_star"].rename("base")
        parts.append(own.join(base, on=cell))
    found = pd.concat(parts, ignore_index=True)
    return found.assign(value=100 * (found["mrr_star"] - found["base"]))


def convergence(cells: pd.DataFrame) -> pd.DataFrame:
    """As ``value``: in scope all whether a run needs any epoch at all, in per cent; epochs in others."""
    late = 100.0 * (cells["epochs"] > 0)
    return cells.assign(value=late.where(cells["scope"] == "all", cells["epochs"]))


def means(at_once: pd.DataFrame, cells: pd.DataFrame, models: Sequence[str]) -> pd.DataFrame:
    """Means over seeds by model and k, models in their order.

    Args:
        at_once: runs right after insertion, told apart by model and k.
        cells: epochs to convergence, likewise.
    """
    mrr_star = 100 * at_once.groupby(["model", "k", "scope"])["mrr_star"].mean().unstack("scope")
    mrr_star = mrr_star.reindex(columns=("all", "novel"))
    groups = cells.groupby(["model", "k", "scope"])
    epochs = groups["epochs"].mean().unstack("scope").reindex(columns=SCOPES)
    never = 100 * (1 - groups["converged"].mean()).unstack("scope").reindex(columns=SCOPES)
    columns = {f"{scope}: MRR*": mrr_star[scope] for scope in ("all", "novel")}
    for scope in SCOPES:
        columns |= {f"{scope}: epochs": epochs[scope], f"{scope}: unconverged %": never[scope]}
    frame = pd.DataFrame(columns, index=mrr_star.index, dtype=float)
    return frame.loc[[model for model in models if model in frame.index]]


def chosen_sizes(
    found: pd.DataFrame, options: Mapping[str, Mapping[str, Any]], stated: Mapping[str, int]
) -> dict[str, dict[str, int]]:
    """Indicator set sizes by who chose them and initializer, of those that have one.

    Args:
        found: see ``means``.
        options: of each initializer in this run.
        stated: the paper's sizes.
    """
    models = _models(found)
    ours = {model: int(options[model]["k"]) for model in models if "k" in options.get(model, {})}
    theirs = {model: stated[model] for model in models if model in stated}
    return {"this run": ours, "paper": theirs, "picked by the rule": picked_sizes(found)}


def picked_sizes(found: pd.DataFrame) -> dict[str, int]:
    """What the paper's rule picks for each initializer."""
    return {
        model: select_size(
            found.loc[model].index.tolist(),
            (found.loc[model]["novel: MRR*"] / 100).tolist(),
            found.loc[model]["novel_heldout: epochs"].tolist(),
        )
        for model in _models(found)
    }


def best_sizes(found: pd.DataFrame) -> dict[str, int]:
    """The size of the best immediate MRR* in scope all, for each initializer."""
    column = found["all: MRR*"]
    return {model: int(column.loc[model].dropna().idxmax()) for model in _models(found)
            if column.loc[model].notna().any()}  # fmt: skip


def _models(found: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(found.index.get_level_values("model")))


def indicator_sizes(found: pd.DataFrame, chosen: Chosen) -> Table:
    """The indicator set size that the paper's rule picks, beside those of this run and of the paper."""
    lines = []
    for model, picked in chosen["picked by the rule"].items():
        own = found.loc[model]
        best = own["novel: MRR*"].idxmax() if own["novel: MRR*"].notna().any() else None
        lines.append(
            {"initializer": label(model), **{who: sizes.get(model) for who, sizes in chosen.items()}}
            | {
                "picked: MRR*": own["novel: MRR*"][picked],
                "picked: epochs": own["novel_heldout: epochs"][picked],
                "best MRR*": own["novel: MRR*"].max(),
                "best at": best,
            }
        )
    return Table(
        "indicator_sizes",
        "Indicator set sizes",
        "The size that params use, the paper's, and the one that the paper's rule picks from this run: grow the set "
        "while the mean number of epochs over three neighbouring sizes still falls by at least 1, and stop where MRR* "
        "falls 1 point below the best. It is applied to immediate MRR* (points) about novel entities and to epochs to "
        "convergence over their held-out triples, means over seeds, since over all queries there is next to "
        "nothing left to converge.",
        pd.DataFrame(lines),
    )


def sensitivity(found: pd.DataFrame) -> Table:
    """The numbers behind Figures 2a and 2b."""
    frame = found.reset_index()
    frame["model"] = frame["model"].map(label)
    return Table(
        "sensitivity",
        "Sensitivity to the indicator set size",
        "Immediate MRR* (points), epochs to convergence and the share of runs that never converge, means over seeds.",
        frame.rename(columns={"model": "initializer", "k": "indicators"}),
        folded=True,
    )


def drawn(
    rows: pd.DataFrame,
    models: Sequence[str],
    chosen: Chosen,
    shown: Sequence[tuple[str, str, str]],
    lowest: float | None = None,
) -> Canvas:
    """Means and intervals of ``value`` by k, with the sizes that were chosen.

    Args:
        shown: scope, title and label of the y-axis of each panel.
    """
    canvas, axes = panels(len(shown))
    for panel, (scope, title, ylabel) in zip(axes, shown, strict=True):
        for model in models:
            own = rows[(rows["model"] == model) & (rows["scope"] == scope)]
            if len(own):
                line = over_seeds(own, ["k"], {"value": "value"}, scale=1)
                _draw(panel, line, colour(model, models), label(model))
                _mark(panel, line["value"], colour(model, models), {who: k.get(model) for who, k in chosen.items()})
        panel.set(title=title, xlabel="indicators k", ylabel=ylabel)
        panel.set_ylim(bottom=lowest)
    for who, (marker, fill, size) in _MARKS.items():
        axes[-1].plot([], [], color="#555555", ls="", marker=marker, fillstyle=fill, ms=size, label=who)
    legend(canvas, axes)
    return canvas


def _draw(axes: Axes, line: pd.DataFrame, colour: str, name: str) -> None:
    axes.plot(line.index, line["value"], color=colour, label=name, lw=1.4)
    axes.fill_between(line.index, line["value" + LOW], line["value" + HIGH], color=colour, alpha=0.15, lw=0)


def _mark(axes: Axes, line: pd.Series, colour: str, chosen: Mapping[str, int | None]) -> None:
    """Mark the sizes that were chosen on the line of means; those beyond it have no mark."""
    for who, k in chosen.items():
        if k is not None:
            marker, fill, size = _MARKS[who]
            height = np.interp(k, line.index, line, left=np.nan, right=np.nan)
            axes.plot(k, height, color=colour, ls="", marker=marker, fillstyle=fill, ms=size, clip_on=False)


SECTION = Section("sensitivity", "How many indicators", contents)
