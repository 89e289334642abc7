"""Figures for files and the page: style, panels, lines with intervals, legends,
colours and alternative texts.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Self

import matplotlib as mpl
import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from isi.report.stats import Estimates, over_seeds, where
from isi.report.words import (
    JOINT,
    SCOPES,
    Names,
    capitalized,
    colour,
    controls,
    label,
    line_style,
)

#: Matplotlib settings of every figure. Draw and render within ``matplotlib.rc_context(STYLE)``.
STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "svg.hashsalt": "isi",
    "svg.fonttype": "none",
    "figure.dpi": 160,
    "text.parse_math": False,  # names may have dollar signs
}
_LEGEND_ROW = 5  # maximum number of legend entries in a row


@dataclass(frozen=True, eq=False)
class Chart:
    """A figure of the main page (``isi.report.charts``) in two layouts;
    ``narrow`` is None if one fits everywhere.
    """

    wide: Canvas
    narrow: Canvas | None
    words: str  #: alternative text


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawn figure and the name of its files; ``in_words`` gives its alternative text."""

    name: str
    canvas: Canvas
    chart: Chart | None = None

    @classmethod
    def of(cls, name: str, drawn: Canvas | Chart) -> Self:
        """A figure by what was drawn."""
        return cls(name, drawn.wide, drawn) if isinstance(drawn, Chart) else cls(name, drawn)


def rendered(canvas: Canvas, form: str) -> bytes:
    """A canvas as ``svg`` or ``png``; equal figures give equal bytes.
    The first call fixes the layout.
    """
    buffer = BytesIO()
    with mpl.rc_context(STYLE):
        canvas.savefig(buffer, format=form, metadata={"Date": None} if form == "svg" else None)
    canvas.set_layout_engine("none")
    return rounded(buffer.getvalue().decode()).encode() if form == "svg" else buffer.getvalue()


def panels(
    number: int, columns: int = 2, height: float = 3.6, width: float = 8
) -> tuple[Canvas, list[Axes]]:
    """A canvas of ``height`` times ``width`` inches, and its panels, ``columns`` in a row;
    unused places are blank.
    """
    canvas = Canvas(figsize=(width, height), layout="constrained")
    axes = list(canvas.subplots(-(-number // columns), columns, squeeze=False).flat)
    for blank in axes[number:]:
        blank.axis("off")
    return canvas, axes[:number]


def in_words(canvas: Canvas) -> str:
    """Alternative text by panel: titles; first and last y-value of each line;
    of rows with names, their x-values.
    """
    texts = []
    for axes in canvas.axes:
        sides = (("across", axes.get_xlabel()), ("up", axes.get_ylabel()))
        titles = [axes.get_title().replace("\n", ", ")]
        titles += [f"{side}: {text}" for side, text in sides if text]
        names = [] if axes.get_ylabel() else [text.get_text() for text in axes.get_yticklabels()]
        numbers = _values_of_rows(axes, names) if names else _ends_of_lines(axes)
        parts = [capitalized("; ".join(filter(None, titles))), numbers]
        if any(parts):
            texts.append(f"{'. '.join(filter(None, parts))}.")
    return " ".join(texts)


def _entries(axes: Axes) -> Iterator[tuple[str, Any]]:
    """The names in a panel's legend, each with its line or bar."""
    for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
        yield name, handle[0] if isinstance(handle, Container) else handle


def _values_of_rows(axes: Axes, names: Names) -> str:
    rows = {name: list[str]() for name in names}
    of_level = list(rows.values())
    for name, drawn in _entries(axes):
        is_line = isinstance(drawn, Line2D)
        points = drawn.get_xydata() if is_line else [(drawn.get_width(), drawn.get_y())]
        for value, level in points:
            of_level[round(level)].append(f"{name} {value:.1f}")
    return "; ".join(f"{row}: {', '.join(values)}" for row, values in rows.items())


def _ends_of_lines(axes: Axes) -> str:
    lines = []
    for name, line in _entries(axes):
        if isinstance(line, Line2D):
            points = np.asarray(line.get_xydata(), dtype=float)
            heights = points[~np.isnan(points).any(1), 1]
            if len(heights):
                start = f"from {heights[0]:.1f} to " if len(np.unique(heights)) > 1 else ""
                lines.append(f"{name} {start}{heights[-1]:.1f}")
    return ", ".join(lines)


def by_epoch(
    runs: pd.DataFrame,
    models: Names,
    scopes: Names,
    margin: float | None = None,
    ylabels: Names = ("MRR* (points)",),
) -> Canvas:
    """MRR* by epoch, a panel for each scope; lines at the joint model's mean J and, if given,
    at J − ``margin``.

    The first ten epochs take about half of the width, since most changes are there; then every
    fifth is drawn.
    """
    canvas, axes = panels(len(scopes))
    for place, (panel, scope) in enumerate(zip(axes, scopes, strict=True)):
        shown = runs[(runs["scope"] == scope) & ((runs["epoch"] <= 10) | (runs["epoch"] % 5 == 0))]
        for model in models:  # controls have no band: more bands would hide each other
            band = 0 if controls([model]) else 0.1
            with_band(
                panel,
                where(shown, model=model),
                "epoch",
                "mrr_star",
                100,
                band,
                lw=1.4 if band else 1,
                **line_style(model, models),
            )
        joint = 100 * shown.loc[shown["model"] == JOINT, "mrr_star"].mean()
        panel.axhline(joint, color=colour(JOINT, models), lw=1.2, ls="--", label=label(JOINT))
        if margin is not None:
            panel.axhline(
                joint - 100 * margin,
                color=colour(JOINT, models),
                lw=1,
                ls=":",
                label="margin of convergence",
            )
        last = int(runs["epoch"].max()) if len(runs) else 0
        panel.set_xscale("symlog", linthresh=10, linscale=1.2)
        ticks = [epoch for epoch in (0, 2, 4, 6, 8, 10, 20, 50, 150) if epoch <= last]
        panel.set_xticks(ticks, list(map(str, ticks)))
        panel.minorticks_off()
        panel.set_xlim(-0.3, max(last, 1) * 1.05)
        title, ylabel = SCOPES.get(scope, scope), ylabels[min(place, len(ylabels) - 1)]
        panel.set(title=title, xlabel="epoch of fine-tuning", ylabel=ylabel)
    legend(canvas, axes)
    return canvas


def with_band(
    panel: Axes, rows: pd.DataFrame, by: str, column: str, scale: int, band: float, **style: Any
) -> np.ndarray:
    """Draw means over seeds as a line, intervals as a band of opacity ``band``;
    returns ``line_over_seeds``.
    """
    values, mean, low, high = line = line_over_seeds(rows, by, column, scale)
    if len(rows):
        panel.plot(values, mean, **style)
        if band:
            panel.fill_between(values, low, high, color=style["color"], alpha=band, lw=0)
    return line


def by_row(
    rows_of: Mapping[str, Mapping[str, Estimates]],
    models: Names,
) -> Canvas:
    """A panel for each title: a row for each group, a dot with its interval for each model;
    keys: title, row, model.
    """
    number = max(len(rows) for rows in rows_of.values())
    canvas, axes = panels(
        len(rows_of), 1 if "" in rows_of else 2, 0.9 + number * (0.25 + 0.06 * len(models))
    )
    for panel, (title, rows) in zip(axes, rows_of.items(), strict=True):
        for place, model in enumerate(models):
            shown = [(level, row[model]) for level, row in enumerate(rows.values()) if model in row]
            heights = [
                level + (place - (len(models) - 1) / 2) * 0.8 / len(models) for level, _ in shown
            ]
            means = np.array([estimate.parts for _, estimate in shown]).reshape(-1, 3)
            panel.errorbar(
                means[:, 0],
                heights,
                xerr=np.abs(means[:, 1:] - means[:, :1]).T,
                marker="o",
                ms=3,
                lw=0,
                elinewidth=1,
                **{**line_style(model, models), "ls": ""},
            )
        panel.set_yticks(range(len(rows)), list(rows))
        panel.invert_yaxis()
        panel.grid(visible=False, axis="y")
        for level in range(1, len(rows)):
            panel.axhline(level - 0.5, color="#cccccc", lw=0.6)
        panel.set(title=title, xlabel="MRR* (points)")
    legend(canvas, axes)
    return canvas


def line_over_seeds(rows: pd.DataFrame, by: str, column: str, scale: float = 100.0) -> np.ndarray:
    """Rows: values of ``by``; means over seeds, and lower and upper bounds, times ``scale``;
    shape (4, values).
    """
    line = over_seeds(rows, [by], {column: "mean"}, scale)["mean"]
    return (
        np.array([(value, *estimate.parts) for value, estimate in line.items()], dtype=float)
        .reshape(-1, 4)
        .T
    )


def legend(canvas: Canvas, axes: Sequence[Axes]) -> None:
    """Letter the panels; add one legend for all, below them,
    in order along rows (matplotlib fills columns).
    """
    entries: dict[str, Any] = {}
    for letter, panel in zip("abcdefgh", axes, strict=False):
        if len(axes) > 1:
            panel.set_title(f"({letter}) {panel.get_title()}")
        for handle, name in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, handle)
    if entries:
        columns = -(-len(entries) // -(-len(entries) // _LEGEND_ROW))
        filled = [name for first in range(columns) for name in list(entries)[first::columns]]
        drawn = canvas.legend(
            [entries[name] for name in filled], filled, loc="outside lower center", ncols=columns
        )
        rows: Any = [
            row
            for column in drawn.get_children()[0].get_children()[1].get_children()
            for row in column.get_children()
        ]
        for name, (handles, text) in zip(filled, (row.get_children() for row in rows), strict=True):
            entry = entries[name]
            gid = entry.get_children()[0].get_gid() if isinstance(entry, Container) else None
            for place, part in enumerate(
                (*text.get_children(), *handles.get_children()) if gid else ()
            ):
                part.set_gid(f"{gid}-legend-{place}")


def rounded(svg: str) -> str:
    """An SVG with coordinates rounded to 0.01 and numbered ids,
    so that the last bits of numbers do not change it.
    """

    def shorter(attribute: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", attribute[0])

    # hashes of unrounded coordinates
    hashed = dict.fromkeys(re.findall(r' id="((?:C\w+_|[mp])[\da-f]{10})"', svg))
    names = {name: f"i{number}" for number, name in enumerate(hashed)}
    svg = re.sub(
        r'(?<=[#"])(?:C\w+_|[mp])[\da-f]{10}(?=[)"])', lambda name: names.get(name[0], name[0]), svg
    )
    return re.sub(r' (?:d|x|y|width|height|transform)="[^"]*"', shorter, svg)


def without_bare_groups(svg: str) -> str:
    """An SVG without the groups that have no attribute, which are most of its elements."""
    shown = list[bool]()

    def tag(match: re.Match[str]) -> str:
        if match[0] != "</g>":
            shown.append(match[0] != "<g>")
            return match[0] if shown[-1] else ""
        return match[0] if shown.pop() else ""

    return re.sub(r"<g(?: [^>]*)?>|</g>", tag, svg)


def inline(svg: str, name: str) -> Markup:
    """A matplotlib SVG as a small element of the page;
    the prefix ``name`` makes its ids and classes unique within the page.
    """
    classes = dict[str, str]()

    def class_of(style: re.Match[str]) -> str:
        return f'class="{classes.setdefault(style[1], f"{name}-{len(classes)}")}"'

    body = svg[svg.index("<defs>") :]
    body = re.sub(r"<style .*?</style>|font-family: [^;\"]*;? ?", "", body)
    body = re.sub(r' id="[a-z\d.]+_\d+"|(?<= )xlink:|\n *(?=<)', "", body)
    body = without_bare_groups(body)
    body = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
    body = re.sub(r'style="([^"]*)"', class_of, body)
    box = re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)[0]
    view = f'viewBox="0 0 {" ".join(box)}" style="min-width: {0.9 * float(box[0]):.0f}px"'
    rules = "".join(f".{place}{{{style}}}" for style, place in classes.items())
    return Markup(f'<svg aria-hidden="true" {view}><style>{rules}</style>{body}')  # noqa: S704
