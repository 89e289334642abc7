"""The figures of the report: each a function of the results that draws on axes of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from scipy import stats

from isi.report.results import JOINT, Experiment, Results
from isi.report.tables import CONTROLS, label

#: Okabe and Ito's colours, which most colour-blind readers can tell apart.
COLOURS = {
    "xavier": "#999999", "iu": "#e69f00", "es": "#0072b2", "rs": "#009e73", "ers": "#d55e00", JOINT: "#000000",
    "mean": "#a08a5b", "gaussian": "#a58fbf", "gaussian_centred": "#c79aa6", "es_permuted": "#8db4cf",
}  # fmt: skip
#: Dashes of what is no initializer under test: the joint model, and controls, which are also drawn thinner.
_DASHES: Any = {JOINT: "--", **dict.fromkeys(CONTROLS, (0, (3, 1.5)))}
_SPARE = ("#cc79a7", "#56b4e9", "#f0e442", "#8c564b")
_LEGEND_ROW = 7  # entries that fit beside each other
_STYLE: Any = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3,
    "legend.frameon": False, "svg.hashsalt": "isi", "svg.fonttype": "path", "figure.dpi": 160,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawn figure."""

    name: str
    title: str
    caption: str
    canvas: Canvas

    @cache  # noqa: B019  (as short-lived as the report)
    def rendered(self, form: str) -> bytes:
        """The figure as ``svg`` or ``png``; equal figures are equal bytes."""
        buffer = BytesIO()
        with mpl.rc_context(_STYLE):
            self.canvas.savefig(buffer, format=form, metadata={"Date": None} if form == "svg" else None)
        return buffer.getvalue()


def immediate(results: Results) -> Figure:
    """Figure 3a: immediate MRR* against the number of novel entities."""
    canvas, (left, right) = panels(2)
    for axes, scope in ((left, "all"), (right, "novel")):
        shown = results.at_once[results.at_once["scope"] == scope]
        for model in results.models:
            _draw(axes, results, model, shown[shown["model"] == model], "size", bars=True)
        axes.set(title=f"scope {scope}", xlabel="novel entities |ξ|", ylabel="MRR* (points)")
        axes.set_xticks(sorted(results.params.sessions.sizes))
    legend(canvas, left)
    return Figure(
        "figure3a_immediate",
        "Figure 3a. Immediate MRR*",
        "MRR* right after insertion against the number of novel entities, mean and 95 % interval over seeds: over "
        "all queries (left, the paper's figure) and over the queries about the novel entities (right; the joint model "
        "has been trained on most of these, so it is no bound there).",
        canvas,
    )


def curves(results: Results) -> Figure | None:
    """Figure 3b: MRR* by epoch of fine-tuning; None where no size is followed to the end."""
    size = results.curve_size
    if size is None:
        return None
    canvas = follow(results, size, ("all", "novel_heldout"), margin=results.params.convergence.margin)
    return Figure(
        "figure3b_curves",
        "Figure 3b. Learning curves",
        f"MRR* by epoch of fine-tuning at |ξ| = {size}, mean and (but for controls) 95 % interval over seeds, over all "
        "queries (left, the paper's figure) and over held-out queries about novel entities (right). Dotted: where a "
        "run of mean joint performance counts as converged.",
        canvas,
    )


def corruption(results: Results) -> Figure | None:
    """Earlier knowledge by epoch, with the novel entities as candidates and without."""
    size = results.curve_size
    if size is None:
        return None
    canvas = follow(results, size, ("known", "known_closed"))
    return Figure(
        "corruption",
        "Earlier knowledge during fine-tuning",
        f"MRR* of queries about known entities at |ξ| = {size}, mean and (but for controls) 95 % interval over seeds: "
        "with the novel entities among the candidates (left) and without (right). A loss on the left alone is "
        "crowding, a loss on the right is damage. Scales differ.",
        canvas,
    )


def follow(experiment: Experiment, size: int, scopes: tuple[str, str], margin: float | None = None) -> Canvas:
    """MRR* by epoch of fine-tuning in two scopes, with the joint model's level.

    Args:
        margin: also draw where a run of mean joint performance counts as converged.
    """
    canvas, both = panels(2)
    runs = experiment.runs[experiment.runs["size"] == size]
    for axes, scope in zip(both, scopes, strict=True):
        shown = runs[runs["scope"] == scope]
        for model in experiment.initializers:
            _draw(axes, experiment, model, shown[shown["model"] == model], "epoch")
        joint = 100 * shown.loc[shown["model"] == JOINT, "mrr_star"].mean()
        axes.axhline(joint, color=COLOURS[JOINT], lw=1.2, label=label(JOINT))
        if margin is not None:
            axes.axhline(joint - 100 * margin, color=COLOURS[JOINT], lw=1, ls=":", label="converged")
        axes.set(title=f"scope {scope}", xlabel="epoch of fine-tuning", ylabel="MRR* (points)")
    legend(canvas, both[0])
    return canvas


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


def panels(number: int, columns: int = 2, height: float = 3.6) -> tuple[Canvas, list[Axes]]:
    """A canvas of a number of panels, ``columns`` of them in each row."""
    canvas = Canvas(figsize=(8, height), layout="constrained")
    return canvas, list(canvas.subplots(number // columns, columns).flat)


def _draw(axes: Axes, results: Experiment, model: str, rows: pd.DataFrame, x: str, bars: bool = False) -> None:
    """Draw mean and interval over seeds by x: as a line, with a band but for controls, or with bars set apart."""
    if rows.empty:
        return
    line = 100 * intervals(rows["mrr_star"], rows[x])
    how: Any = {"color": colour_of(results, model), "label": label(model), "ls": _DASHES.get(model, "-")}
    control = model in CONTROLS
    place = np.asarray(line.index, dtype=float)
    if bars:
        place += (results.models.index(model) - len(results.models) / 2) * 0.06
        reach = np.stack([line["mean"] - line["low"], line["high"] - line["mean"]])
        axes.errorbar(place, line["mean"], reach, **how, lw=0.9 if control else 1.2, marker="o", ms=2 if control else 3)
    else:
        axes.plot(place, line["mean"], **how, lw=1 if control else 1.4)
        if not control:  # more bands on top of each other would hide all of them
            axes.fill_between(place, line["low"], line["high"], color=how["color"], alpha=0.1, lw=0)


def colour_of(results: Experiment, model: str) -> str:
    """The colour of a model in every figure."""
    own = [name for name in results.initializers if name not in COLOURS]
    return COLOURS[model] if model in COLOURS else _SPARE[own.index(model) % len(_SPARE)]


def legend(canvas: Canvas, axes: Axes) -> None:
    """Below the panels, in two rows where there are many entries; matplotlib fills columns, people read rows."""
    entries = list(zip(*axes.get_legend_handles_labels(), strict=True))
    columns = len(entries) if len(entries) <= _LEGEND_ROW else -(-len(entries) // 2)
    handles, labels = zip(*(entry for first in range(columns) for entry in entries[first::columns]), strict=True)
    canvas.legend(handles, labels, loc="outside lower center", ncols=columns)


FIGURES: tuple[Callable[[Results], Figure | None], ...] = (immediate, curves, corruption)


def draw(results: Results, functions: Sequence[Callable[[Results], Figure | None]]) -> list[Figure]:
    """Every figure that the results allow."""
    with mpl.rc_context(_STYLE):
        return [figure for function in functions if (figure := function(results)) is not None]
