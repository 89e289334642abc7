"""How figures are drawn: their style, panels, lines of means with intervals, and legends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from isi.report.models import JOINT, colour, is_control, label, line_style
from isi.report.stats import over_seeds
from isi.report.svg import rounded
from isi.report.words import SCOPES, capitalized

#: Of every figure of the project; drawing and rendering happen within ``matplotlib.rc_context`` of it.
STYLE: Any = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3,
    "legend.frameon": False, "svg.hashsalt": "isi", "svg.fonttype": "none", "figure.dpi": 160,
}  # fmt: skip
#: Titles of panels.
_HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity prediction", "mrr_star_relation": "relation prediction"}
_LEGEND_ROW = 5  # entries that fit beside each other


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawn figure under the name of its files; what it shows is said in words from what was drawn (``in_words``)."""

    name: str
    canvas: Canvas


def rendered(canvas: Canvas, form: str) -> bytes:
    """A canvas as ``svg`` or ``png``; equal figures are equal bytes."""
    buffer = BytesIO()
    with mpl.rc_context(STYLE):
        canvas.savefig(buffer, format=form, metadata={"Date": None} if form == "svg" else None)
    return rounded(buffer.getvalue().decode()).encode() if form == "svg" else buffer.getvalue()


def panels(number: int, columns: int = 2, height: float = 3.6) -> tuple[Canvas, list[Axes]]:
    """A canvas of a number of panels, ``columns`` of them in each row; what the last row has more stays blank."""
    canvas = Canvas(figsize=(8, height), layout="constrained")
    axes = list(canvas.subplots(-(-number // columns), columns, squeeze=False).flat)
    for blank in axes[number:]:
        blank.axis("off")
    return canvas, axes[:number]


def single(width: float, height: float) -> tuple[Canvas, Axes]:
    """A canvas of one panel, in inches."""
    canvas = Canvas(figsize=(width, height), layout="constrained")
    return canvas, canvas.subplots()


def in_words(canvas: Canvas) -> str:
    """What was drawn, panel by panel: where each line begins and ends, in its own numbers."""
    return " ".join(text for axes in canvas.axes if (text := _panel_in_words(axes)))


def _panel_in_words(axes: Axes) -> str:
    lines = []
    for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
        line = handle[0] if isinstance(handle, Container) else handle
        points = np.asarray(line.get_xydata(), dtype=float) if isinstance(line, Line2D) else np.empty((0, 2))
        points = points[~np.isnan(points).any(1)]
        if len(points):
            begins, ends = points[0, 1], points[-1, 1]
            level = len(np.unique(points[:, 1])) == 1
            lines.append(f"{name} {ends:.1f}" if level else f"{name} from {begins:.1f} to {ends:.1f}")
    names = [tick.get_text() for tick in axes.get_yticklabels()]
    values = [text.get_text() for text in axes.texts]
    if not lines and len(names) == len(values) and names:
        lines = [f"{name} {value}" for name, value in zip(names, values, strict=True)]
    across, up = axes.get_xlabel(), axes.get_ylabel()
    parts = (axes.get_title().replace("\n", ", "), f"across: {across}" if across else "", f"up: {up}" if up else "")
    text = ". ".join(part for part in (capitalized("; ".join(filter(None, parts))), ", ".join(lines)) if part)
    return f"{text}." if text else ""


def by_size(
    immediate: pd.DataFrame, models: Sequence[str], scopes: Sequence[str], measures: Sequence[str], entities: int
) -> Canvas:
    """MRR* right after insertion against the number of novel entities: a row for each measure, a panel for each scope.

    Args:
        measures: columns of runs.
        entities: of the graph, of which the upper axis gives the share.
    """
    canvas, drawn = panels(len(measures) * len(scopes), len(scopes), height=0.6 + 3 * len(measures))
    shown = [(measure, scope) for measure in measures for scope in scopes]
    for axes, (measure, scope) in zip(drawn, shown, strict=True):
        rows = immediate[immediate["scope"] == scope]
        for place, model in enumerate(models):
            aside = (place - len(models) / 2) * min(0.06, 0.8 / len(models))
            _bars(axes, models, model, rows[rows["model"] == model], measure, aside)
        axes.set(title=f"{SCOPES.get(scope, scope)}: {_HALVES[measure]}", xlabel="novel entities |ξ|", ylabel="points")
        axes.set_xticks(sorted(immediate["size"].unique()))
        above = axes.secondary_xaxis("top", functions=(_scaled(100 / entities), _scaled(entities / 100)))
        above.set_xlabel("% of |E|", fontsize=8)
        above.tick_params(labelsize=8)
    legend(canvas, drawn)
    return canvas


def by_epoch(
    runs: pd.DataFrame, models: Sequence[str], scopes: Sequence[str], ylabel: str = "MRR* (points)",
    margin: float | None = None,
) -> Canvas:  # fmt: skip
    """MRR* by epoch of fine-tuning, a panel for each scope, with the joint model's level.

    Args:
        runs: of one size, the joint model's among them.
        margin: also draw where a run of mean joint performance counts as converged.
    """
    canvas, drawn = panels(len(scopes))
    for axes, scope in zip(drawn, scopes, strict=True):
        shown = runs[runs["scope"] == scope]
        for model in models:
            _curve(axes, models, model, shown[shown["model"] == model])
        joint = 100 * shown.loc[shown["model"] == JOINT, "mrr_star"].mean()
        axes.axhline(joint, color=colour(JOINT, models), lw=1.2, label=label(JOINT))
        if margin is not None:
            axes.axhline(joint - 100 * margin, color=colour(JOINT, models), lw=1, ls=":", label="converged")
        axes.set(title=SCOPES[scope], xlabel="epoch of fine-tuning", ylabel=ylabel)
    legend(canvas, drawn)
    return canvas


def by_row(axes: Axes, rows: pd.DataFrame, models: Sequence[str], ticks: Sequence[str]) -> None:
    """A line for each model through the rows, in points; ``rows`` have a column of estimates for each model."""
    for model in models:
        cells = rows.get(model, pd.Series(np.nan, rows.index))
        means = [getattr(cell, "mean", np.nan) for cell in cells]
        axes.plot(range(len(rows)), means, marker="o", ms=4, lw=1, **line_style(model, models))
    axes.set_xticks(range(len(rows)), ticks)
    axes.set_ylabel("points")


def means_and_bounds(estimates: pd.Series) -> np.ndarray:
    """Means, lower and upper bounds of estimates; shape: (3, rows)."""
    return np.array([estimate.parts for estimate in estimates], dtype=float).reshape(-1, 3).T


def _scaled(factor: float) -> Callable[[Any], Any]:
    return lambda value: np.asarray(value) * factor


def _bars(axes: Axes, models: Sequence[str], model: str, rows: pd.DataFrame, measure: str, aside: float) -> None:
    """Mean and interval over seeds by size, a little aside of others; controls are thinner."""
    if rows.empty:
        return
    line = over_seeds(rows, ["size"], {measure: "mean"})["mean"]
    mean, low, high = means_and_bounds(line)
    width, mark = (0.9, 2) if is_control(model) else (1.2, 3)
    axes.errorbar(np.asarray(line.index, dtype=float) + aside, mean, np.stack([mean - low, high - mean]),
                  **line_style(model, models), lw=width, marker="o", ms=mark)  # fmt: skip


def _curve(axes: Axes, models: Sequence[str], model: str, rows: pd.DataFrame) -> None:
    """Mean over seeds by epoch, with a band but for controls: more bands would hide each other."""
    if rows.empty:
        return
    line, control = over_seeds(rows, ["epoch"], {"mrr_star": "mean"})["mean"], is_control(model)
    mean, low, high = means_and_bounds(line)
    axes.plot(line.index, mean, **line_style(model, models), lw=1 if control else 1.4)
    if not control:
        axes.fill_between(line.index, low, high, color=colour(model, models), alpha=0.1, lw=0)


def legend(canvas: Canvas, drawn: Sequence[Axes]) -> None:
    """Below the panels, what any of them shows: models as they were drawn, then lines and marks of other kinds.

    In several rows where there are many entries; matplotlib fills columns, people read rows.
    """
    entries: dict[str, Any] = {}
    for axes in drawn:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, handle)
    if not entries:
        return
    columns = -(-len(entries) // -(-len(entries) // _LEGEND_ROW))
    filled = [name for first in range(columns) for name in list(entries)[first::columns]]
    canvas.legend([entries[name] for name in filled], filled, loc="outside lower center", ncols=columns)
