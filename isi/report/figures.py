"""How figures are drawn: their style, panels, lines and legend."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from isi.report.models import JOINT, colour, dashes, is_control, label
from isi.report.statistics import intervals

#: Of every figure of the project; drawing and rendering happen within ``matplotlib.rc_context`` of it.
STYLE: Any = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.alpha": 0.3,
    "legend.frameon": False, "svg.hashsalt": "isi", "svg.fonttype": "path", "figure.dpi": 160,
}  # fmt: skip
_LEGEND_ROW = 7  # entries that fit beside each other


def rendered(canvas: Canvas, form: str) -> bytes:
    """A canvas as ``svg`` or ``png``; equal figures are equal bytes."""
    buffer = BytesIO()
    with mpl.rc_context(STYLE):
        canvas.savefig(buffer, format=form, metadata={"Date": None} if form == "svg" else None)
    return buffer.getvalue()


def panels(number: int, columns: int = 2, height: float = 3.6) -> tuple[Canvas, list[Axes]]:
    """A canvas of a number of panels, ``columns`` of them in each row; what the last row has more stays blank."""
    canvas = Canvas(figsize=(8, height), layout="constrained")
    drawn = list(canvas.subplots(-(-number // columns), columns, squeeze=False).flat)
    for blank in drawn[number:]:
        blank.axis("off")
    return canvas, drawn[:number]


def by_size(at_once: pd.DataFrame, models: Sequence[str], scopes: Sequence[str]) -> Canvas:
    """MRR* right after insertion against the number of novel entities, a panel for each scope."""
    canvas, drawn = panels(len(scopes))
    for axes, scope in zip(drawn, scopes, strict=True):
        shown = at_once[at_once["scope"] == scope]
        for place, model in enumerate(models):
            _bars(axes, models, model, shown[shown["model"] == model], (place - len(models) / 2) * 0.06)
        axes.set(title=f"scope {scope}", xlabel="novel entities |ξ|", ylabel="MRR* (points)")
        axes.set_xticks(sorted(at_once["size"].unique()))
    legend(canvas, drawn[0])
    return canvas


def by_epoch(
    runs: pd.DataFrame, initializers: Sequence[str], scopes: Sequence[str], margin: float | None = None
) -> Canvas:
    """MRR* by epoch of fine-tuning, a panel for each scope, with the joint model's level.

    Args:
        runs: of one size, the joint model's among them.
        margin: also draw where a run of mean joint performance counts as converged.
    """
    canvas, drawn = panels(len(scopes))
    for axes, scope in zip(drawn, scopes, strict=True):
        shown = runs[runs["scope"] == scope]
        for model in initializers:
            _curve(axes, initializers, model, shown[shown["model"] == model])
        joint = 100 * shown.loc[shown["model"] == JOINT, "mrr_star"].mean()
        axes.axhline(joint, color=colour(JOINT, initializers), lw=1.2, label=label(JOINT))
        if margin is not None:
            level = joint - 100 * margin
            axes.axhline(level, color=colour(JOINT, initializers), lw=1, ls=":", label="converged")
        axes.set(title=f"scope {scope}", xlabel="epoch of fine-tuning", ylabel="MRR* (points)")
    legend(canvas, drawn[0])
    return canvas


def _bars(axes: Axes, models: Sequence[str], model: str, rows: pd.DataFrame, aside: float) -> None:
    """Mean and interval over seeds by size, a little aside of others; controls are thinner."""
    if rows.empty:
        return
    line = _over_seeds(rows, "size")
    reach = np.stack([line["mean"] - line["low"], line["high"] - line["mean"]])
    width, mark = (0.9, 2) if is_control(model) else (1.2, 3)
    axes.errorbar(np.asarray(line.index, dtype=float) + aside, line["mean"], reach, **_how(models, model), lw=width,
                  marker="o", ms=mark)  # fmt: skip


def _curve(axes: Axes, models: Sequence[str], model: str, rows: pd.DataFrame) -> None:
    """Mean over seeds by epoch, with a band but for controls: more bands would hide each other."""
    if rows.empty:
        return
    line, control = _over_seeds(rows, "epoch"), is_control(model)
    axes.plot(line.index, line["mean"], **_how(models, model), lw=1 if control else 1.4)
    if not control:
        axes.fill_between(line.index, line["low"], line["high"], color=colour(model, models), alpha=0.1, lw=0)


def _how(models: Sequence[str], model: str) -> dict[str, Any]:
    return {"color": colour(model, models), "label": label(model), "ls": dashes(model)}


def _over_seeds(rows: pd.DataFrame, x: str) -> pd.DataFrame:
    means = rows.groupby([x, "seed"], as_index=False)["mrr_star"].mean()  # sessions of a seed are no repeats
    return 100 * intervals(means["mrr_star"], means[x])


def legend(canvas: Canvas, axes: Axes) -> None:
    """Below the panels, in two rows where there are many entries; matplotlib fills columns, people read rows."""
    entries = list(zip(*axes.get_legend_handles_labels(), strict=True))
    if not entries:
        return
    columns = len(entries) if len(entries) <= _LEGEND_ROW else -(-len(entries) // 2)
    handles, labels = zip(*(entry for first in range(columns) for entry in entries[first::columns]), strict=True)
    canvas.legend(handles, labels, loc="outside lower center", ncols=columns)
