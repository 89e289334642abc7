"""As many digits as runs on two types of processor agree in: what is written changes where what is shown does."""

from __future__ import annotations

from math import floor, log10
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Annotation

#: Decimals of what is in points of MRR*, in epochs or in per cent; digits of what is of any size.
DECIMALS, DIGITS = 2, 4
#: Limits of axes are kept to a hundredth of their length or less, what is drawn to a fifth of that.
_PARTS, _FINER = 100, 5


def number(value: Any, of_any_size: bool = False) -> Any:
    """A number as files keep it; all else as it is."""
    if not isinstance(value, float) or pd.isna(value):
        return value
    if of_any_size and abs(value) < 10**DIGITS and not float(value).is_integer():
        return float(f"{value:.{DIGITS}g}")
    return round(float(value), DECIMALS) + 0.0  # no -0.0


def csv(frame: pd.DataFrame, of_any_size: tuple[str, ...] = ()) -> str:
    """A table as CSV; columns of numbers ``of_any_size`` keep digits, others decimals."""
    kept = frame.apply(lambda column: column.map(lambda value: number(value, column.name in of_any_size)))
    text: str = kept.to_csv(index=False, float_format="%.10g", lineterminator="\n")
    return text


def steady(canvas: Canvas) -> None:
    """Round what a canvas shows, to less than can be seen: limits of axes, lines, areas and where text points at.

    Otherwise the last bit of one number would move every coordinate of a figure.
    """
    for axes in canvas.axes:
        steps = [_step(*limits) for limits in (axes.get_xlim(), axes.get_ylim())]
        axes.set_xlim(_to(axes.get_xlim(), steps[0]))
        axes.set_ylim(_to(axes.get_ylim(), steps[1]))
        _round_drawn(axes, np.array(steps) / _FINER)


def _step(low: float, high: float) -> float:
    """One, two or five times a power of ten: a hundredth of a length, or less."""
    most = abs(high - low) / _PARTS * (1 + 1e-9)
    power = 10.0 ** floor(log10(most))
    return power * max(nice for nice in (1, 2, 5) if nice * power <= most)


def _to(values: Any, step: Any) -> Any:
    return np.round(np.asarray(values, dtype=float) / step) * step


def _round_drawn(axes: Axes, steps: np.ndarray) -> None:
    """Round all that stands at coordinates of the data; ``steps``: of both axes."""

    def rounded(points: Any, of: Artist) -> np.ndarray:
        own = np.array(points, dtype=float)
        for place, in_data in enumerate(of.get_transform().contains_branch_seperately(axes.transData)):
            if in_data:
                own[:, place] = _to(own[:, place], steps[place])
        return own

    for line in axes.lines:
        line.set_data(*rounded(line.get_xydata(), line).T)
    for area in axes.collections:
        for path in area.get_paths():
            path.vertices = rounded(path.vertices, area)
    for text in axes.texts:
        if isinstance(text, Annotation):
            text.xy = tuple(_to(text.xy, steps)) if text.xycoords == "data" else text.xy
            how = {"data": steps, "axes fraction": 0.001}.get(str(text.anncoords))
            text.xyann = text.xyann if how is None else tuple(_to(text.xyann, how))
