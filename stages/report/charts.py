"""Figures: panels that are drawn on axes of matplotlib, each alone for the page, and all of a
figure together for its files.

A name has one colour, dash and mark in all figures of all pages (``palette.yaml``).
"""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

from isi import config

PALETTE = config.read(Path(__file__).with_name("palette.yaml"))
WIDTH, HEIGHT = 480, 264  #: Of a panel in pixels (1/72 inch).
LEAST = 10.0  #: Least range of the axis of values, in points or epochs: noise is not drawn large.
DENSE = 10  #: The last epoch of the linear part of an axis of epochs; later ones are logarithmic.
INK, SOFT, LINE = (PALETTE["page"][name] for name in ("ink", "soft", "line"))
#: Label of the axis below lines, and how a place on it is called, by column.
XLABELS = {
    "epoch": ("epoch of fine-tuning", "epoch"),
    "indicators": ("indicators k", "k ="),
    "size": ("novel entities |ξ|", "|ξ| ="),
}
#: Initializers whose lines have a band: the paper's.
BANDED = ("Xavier", "IU", "ES", "RS", "ERS")
#: Colours of names that the palette lacks, in order of their appearance; then again, with the next
#: dash and mark.
_SPARE = ("#8c564b", "#5f8f2f", "#b04a5a", "#4f86a8", "#94752c", "#7d5fa5")
_SPARE_DASHES, _SPARE_MARKS = ("-", "--", ":", "-."), ("o", "s", "D", "^")
#: What a page need not have of a drawing, with what stands in its place: its style sets fonts,
#: and nothing lies outside of the axes.
_SHORTER = {
    r"<defs>\s*<(style|clipPath).*?</defs>|<!--.*?-->|</?g( [^>]*)?>": "",
    r' (width|height|xmlns[:\w]*|version|clip-path)="[^"]*"(?=[^>]*>)': "",
    r' transform="rotate\(-0 [^"]*"': "",
    r'<path d="[^"]*" style="fill: (none|var\(--paper\))"/>': "",
    r" ?(font-size|font-family|stroke-linecap|stroke-linejoin): [^;\"]*;?": "",
    r"\s*\n\s*(?=<)": "",
    r'; ?"': '"',
    r'style=" ': 'style="',
    r' style=""': "",
}


@dataclass(frozen=True)
class Value:
    """What the pointer shows at a point (in data coordinates): values of one place together."""

    x: float
    y: float
    place: str
    name: str
    text: str


@dataclass(frozen=True)
class Panel:
    """A drawing: a function that draws on axes and returns the values at its points."""

    title: str
    draw: Callable[[Axes], list[Value]]
    height: float = HEIGHT
    by: str = "x"  #: the coordinate along which the pointer goes from place to place


def style_of(name: str, names: Sequence[str] = ()) -> dict[str, Any]:
    """Colour, dashes and mark of a name; ``names``: all of its drawing, from which the palette's
    unknown ones are told apart.
    """
    models = PALETTE["models"]
    if name in models:
        colour, dash, mark = models[name]
    else:
        unknown = [other for other in dict.fromkeys((*names, name)) if other not in models]
        turn, place = divmod(unknown.index(name), len(_SPARE))
        colour, turn = _SPARE[place], turn % len(_SPARE_DASHES)
        dash, mark = _SPARE_DASHES[turn], _SPARE_MARKS[turn]
    return {"color": colour, "ls": dash, "marker": mark}


def lines(
    frame: pd.DataFrame,
    x: str,
    y: str,
    title: str,
    *,
    ylabel: str = "MRR (points)",
    level: tuple[str, float] | None = None,
) -> Panel:
    """A line for each model or initializer, with an interval for those of ``BANDED``;
    ``level``: a name and a height that is drawn across.
    """
    name = "model" if "model" in frame else "initializer"
    frame = frame.dropna(subset=y)
    names = list(map(str, dict.fromkeys(frame[name])))
    xlabel, unit = XLABELS[x]

    def draw(axes: Axes) -> list[Value]:
        for each in names:
            rows, style = frame[frame[name] == each], style_of(each, names)
            spacing = 0.2 if len(rows) > 1 else None  # of the axes, between marks
            axes.plot(rows[x], rows[y], **style, label=each, markevery=spacing)
            if each in BANDED:
                ends = rows.get(f"{y} low", rows[y]), rows.get(f"{y} high", rows[y])
                axes.fill_between(rows[x], *ends, color=style["color"], alpha=0.13, lw=0)
        if level and not np.isnan(level[1]):
            axes.axhline(level[1], color=SOFT, ls=":", label=level[0])
        if len(frame) and x == "epoch" and frame[x].max() > 2 * DENSE:
            _widen_the_start(axes, frame[x].max())
        axes.set(xlabel=xlabel, ylabel=ylabel)
        _widen(axes)
        return [
            Value(row[x], row[y], f"{unit} {row[x]:g}", row[name], _text(row, y))
            for row in frame.to_dict("records")
        ]

    return Panel(title, draw)


def _widen(axes: Axes) -> None:
    """Give the axis of values its least range; none is below 0."""
    low, high = axes.get_ylim()
    missing = max(0.0, LEAST - (high - low))
    low = max(0.0, low - missing / 2)
    axes.set_ylim(low, max(high + missing / 2, low + LEAST))


def _widen_the_start(axes: Axes, high: float) -> None:
    """Scale x linearly to ``DENSE`` and by its logarithm from there; a line says so."""
    axes.set_xscale("symlog", linthresh=DENSE, linscale=1.2)
    ticks = [tick for tick in (0, 2, 4, 6, 8, 10, 20, 50, 150) if tick <= high]
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.minorticks_off()
    axes.axvline(DENSE, color=LINE, zorder=0.5)


def _text(row: Mapping[Any, Any], column: str) -> str:
    """A value and its interval, if there is one."""
    text, low, high = f"{row[column]:.1f}", row.get(f"{column} low"), row.get(f"{column} high")
    return text if low is None or low != low else f"{text} [{low:.1f}, {high:.1f}]"


def dots(
    frame: pd.DataFrame, row: str, columns: Mapping[str, str], title: str, *, xlabel: str
) -> Panel:
    """A row for each value of ``row``, from above; a dot for each column (name to column), with its
    interval if there is one.
    """
    frame = frame.dropna(how="all", subset=list(columns.values()))
    labels, names = list(map(str, frame[row])), list(columns)
    many = len(names) > 1  # else each row has a colour of its own
    shifts = np.linspace(-0.16, 0.16, len(names)) if many else [0.0]

    def draw(axes: Axes) -> list[Value]:
        values = list[Value]()
        for (name, column), shift in zip(columns.items(), shifts, strict=True):
            style, at = style_of(name, names), np.arange(len(labels)) + shift
            colours = [(style if many else style_of(label, labels))["color"] for label in labels]
            low, high = (frame.get(f"{column} {end}", frame[column]) for end in ("low", "high"))
            axes.hlines(at, low, high, colors=colours, alpha=0.7)
            shown, mark = (name, style["marker"]) if many else ("", "o")
            axes.scatter(frame[column], at, s=45, c=colours, marker=mark, label=shown)
            values += [
                Value(cells[column], place, str(cells[row]), shown, _text(cells, column))
                for place, cells in zip(at, frame.to_dict("records"), strict=True)
                if cells[column] == cells[column]
            ]
        axes.grid(visible=True)
        axes.set(xlabel=xlabel)
        _name_rows(axes, labels)
        return values

    return Panel(title, draw, 120 + 25 * len(frame), "y")


def _name_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Name the rows of a panel, the first one on top."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)


def bars(frame: pd.DataFrame, title: str) -> Panel:
    """Bars from ``start`` to ``end`` below each other, and a mark where both are equal."""

    def draw(axes: Axes) -> list[Value]:
        values = list[Value]()
        for place, (part, start, end) in enumerate(
            frame[["part", "start", "end"]].itertuples(index=False)
        ):
            style, text = style_of(part), f"{end:.1f}"
            axes.barh(place, end - start, 0.62, start, color=style["color"])
            if start == end:
                axes.plot(end, place, **style | {"ls": ""}, ms=9)
            elif start:
                text = f"{end - start:+.1f}".replace("-", "−")
            axes.annotate(text, (max(start, end), place), (8, 0), textcoords="offset points",
                          va="center_baseline")  # fmt: skip
            values.append(Value(end, place, part, "", text))
        axes.grid(visible=False)
        axes.set(xlabel="MRR (points)", xlim=(0, None))
        _name_rows(axes, list(frame["part"]))
        return values

    return Panel(title, draw, 76 + 24 * len(frame), "y")


# Files


def draw_on(panel: Panel, canvas: FigureBase) -> tuple[Axes, list[Value]]:
    """Draw a panel with its title and its legend on a canvas of its own."""
    axes = canvas.subplots()
    canvas.suptitle(panel.title, x=0.01, ha="left")
    values = panel.draw(axes)
    axes.locator_params(axis="y" if panel.by == "x" else "x", nbins=5)
    names = axes.get_legend_handles_labels()[1]
    for columns in range(len(names), 0, -1):  # as many as fit
        legend = canvas.legend(loc="outside lower left", ncols=columns)
        if columns == 1 or legend.get_window_extent().width < WIDTH:
            break
        legend.remove()
    return axes, values


def _saved(canvas: Figure, form: str) -> bytes:
    """A canvas as a file: the same bytes whenever it is drawn."""
    buffer = io.BytesIO()
    about = ("Date", "Creator", "Format", "Type") if form == "svg" else ("Software",)
    canvas.savefig(buffer, format=form, dpi=110, metadata=dict.fromkeys(about))
    return buffer.getvalue()


def files(panels: Sequence[Panel]) -> dict[str, bytes]:
    """The panels of a figure, two in a row, in one file of each form."""
    columns = min(len(panels), 2)
    rows = [panels[start : start + 2] for start in range(0, len(panels), 2)]
    heights = [max(panel.height for panel in row) for row in rows]
    with mpl.rc_context(PALETTE["settings"]):
        canvas = Figure((WIDTH * columns / 72, sum(heights) / 72), layout="constrained")
        parts = canvas.subfigures(len(rows), columns, squeeze=False, height_ratios=heights)
        for panel, part in zip(panels, parts.flat, strict=False):
            draw_on(panel, part)
        return {form: _saved(canvas, form) for form in ("svg", "png")}


def alone(panel: Panel, name: str) -> tuple[str, dict[str, Any]]:
    """A panel as an SVG element of the page, whose style sets its colours, and the values at its
    points, with places in pixels from the upper left; ``name``: one that no other panel has.
    """
    with mpl.rc_context(PALETTE["settings"] | {"svg.hashsalt": name}):
        canvas = Figure((WIDTH / 72, panel.height / 72), layout="constrained")
        axes, values = draw_on(panel, canvas)
        text = _saved(canvas, "svg").decode()
    for variable, colour in PALETTE["page"].items():
        text = text.replace(colour, f"var(--{variable})")
    names = list(dict.fromkeys(value.name for value in values))
    return shorter(text[text.index("<svg") :]), {
        "by": panel.by,
        "width": WIDTH,
        "below": round(panel.height - axes.get_window_extent().y0),
        "names": names,
        "places": _by_place(panel, axes, values, names),
    }


def shorter(text: str) -> str:
    """A drawing without what a page need not have of it."""
    for pattern, replacement in _SHORTER.items():
        text = re.sub(pattern, replacement, text, flags=re.DOTALL)
    return re.sub(r' (d|x|y|transform)="[^"]*"', _shorter_places, text)


def _shorter_places(attribute: re.Match[str]) -> str:
    """An attribute with its places rounded down to one decimal, and no spaces around letters."""
    rounded = re.sub(r"(\.\d)\d+", r"\1", attribute[0])
    return re.sub(r"(?<!^)\s*([MLCQz])\s*", r"\1", re.sub(r"(\d)\.0(?!\d)", r"\1", rounded))


def _by_place(panel: Panel, axes: Axes, values: Sequence[Value], names: Sequence[str]) -> list[Any]:
    """Where each place is, its name, and of its values from above: the number of the name in
    ``names``, and the text.
    """
    by_place = dict[str, Any]()
    for value in sorted(values, key=attrgetter("y"), reverse=panel.by == "x"):
        x, y = axes.transData.transform((value.x, value.y))
        at = round(x if panel.by == "x" else panel.height - y)
        shown = [names.index(value.name), value.text]
        by_place.setdefault(value.place, [at, value.place, []])[2].append(shown)
    return sorted(by_place.values())
