"""Figures of the main page: one colour for ISI, one for random starts, grey for all others; lines
named at their ends; two layouts, of which the page shows the one that fits.

A point of a canvas is a pixel of the page, so ``FONT`` is the size of text there.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from isi.report import figures
from isi.report.figures import Chart, line_over_seeds
from isi.report.stats import where
from isi.report.tables import Estimate
from isi.report.words import (
    FINETUNE_ONLY,
    HALVES,
    JOINT,
    SCOPES,
    WORDS,
    Names,
    capitalized,
    isi,
    label,
    of_role,
)

FONT = 13  #: Size of text, in pixels.
WIDE, NARROW = 920, 352  #: Widths of the two layouts, in pixels.
INK, SOFT, LINE, PAPER = "#1b1e23", "#5c6470", "#d9dde3", "#ffffff"
ISI, BASE, MUTE = "#b84a00", "#0b5cad", "#8a919c"
#: Colours as variables of the page's style, each with its value where it is dark.
_VARIABLES = {
    INK: ("ink", "#e6e8eb"),
    SOFT: ("soft", "#a0a8b4"),
    LINE: ("line", "#343a42"),
    PAPER: ("paper", "#15181c"),
    ISI: ("isi", "#ffa05c"),
    BASE: ("base", "#7db8f2"),
    MUTE: ("mute", "#7d8590"),
}
#: Initializers that are named in figures though they are no part of the paper.
_NAMED = ("mean", "kind_mean", "map")
_EPOCHS = (0, 1, 2, 5, 10, 20, 50, 150)  #: Epochs whose values are shown at the mouse.
_GAP = 15  #: Between names at the ends of lines, in pixels.
_LETTERS = 17  #: Of the longest name of a bar in one line.
_VALUE = "value"  #: Start of the ``gid`` of what shows its values at the mouse.


@dataclass(frozen=True)
class FigureLayout:
    """A layout: its width in pixels, and the panels in a row."""

    width: int
    columns: int


def drawn(draw: Callable[[FigureLayout], tuple[Canvas, str]], columns: int = 2) -> Chart:
    """A figure in both layouts; ``draw`` gives a canvas and what it shows in words."""
    canvas, text = draw(FigureLayout(WIDE, columns))
    return Chart(canvas, draw(FigureLayout(NARROW, 1))[0], text)


def panels(layout: FigureLayout, number: int, height: float) -> tuple[Canvas, list[Axes]]:
    """A canvas with ``number`` panels of ``height`` pixels each."""
    columns = max(min(layout.columns, number), 1)
    rows = -(-number // columns)
    canvas = Canvas(figsize=(layout.width / 72, rows * height / 72), dpi=110, layout="constrained")
    canvas.get_layout_engine().set(w_pad=0.1, h_pad=0.1)  # type: ignore[union-attr, call-arg]
    axes = list(canvas.subplots(rows, columns, squeeze=False).flat)
    for blank in axes[number:]:
        blank.axis("off")
    for letter, panel in zip("abcdefgh", axes[:number], strict=False):
        panel.set_label(f"({letter}) " if number > 1 else "")
    return canvas, axes[:number]


def framed(axes: Axes, title: str, xlabel: str = "", ylabel: str = "") -> None:
    """Set the titles of a panel and its grid: lines across, and no frame but below."""
    axes.grid(visible=False)
    axes.grid(visible=True, axis="y", color=LINE, lw=1, alpha=1)
    axes.set_axisbelow(True)
    axes.spines[["left", "top", "right"]].set_visible(False)
    axes.spines["bottom"].set(color=MUTE, lw=1)
    for side in ("x", "y"):
        axes.tick_params(axis=side, length=0, pad=5, labelsize=FONT - 0.5, labelcolor=SOFT)
    spec, canvas = axes.get_gridspec(), axes.get_figure()
    columns = spec.ncols if spec else 1
    width = 72 * canvas.get_size_inches()[0] / columns if isinstance(canvas, Canvas) else WIDE
    lines = f"{axes.get_label()}{capitalized(title)}".split("\n")
    whole = "\n".join(fill(text, int(width / 8.4)) for text in lines)
    axes.set_title(
        whole,
        loc="left",
        x=0,
        fontsize=FONT + 0.5,
        color=INK,
        weight="bold",
        pad=24 if ylabel else 8,
    )
    if ylabel:
        place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
        axes.annotate(ylabel, (0, 1), (0, 8), fontsize=FONT - 0.5, color=SOFT, **place)
    if xlabel:
        axes.set_xlabel(xlabel, loc="left", fontsize=FONT - 0.5, color=SOFT, labelpad=5)


def style_of(model: str, models: Names) -> dict[str, Any]:
    """Colour, width and dashes of a model's line: the last initializer of ISI is the thickest."""
    if model == JOINT:
        return {"color": INK, "lw": 1.4, "ls": (0, (5, 3))}
    if model == FINETUNE_ONLY:
        return {"color": MUTE, "lw": 1.8, "ls": (0, (1, 2))}
    if isi([model]):
        return {"color": ISI, "lw": 2.6 if model == isi(models)[-1] else 1.4}
    if of_role([model], "paper"):
        return {"color": BASE, "lw": 2.2 if model == models[0] else 1.4}
    return {"color": MUTE, "lw": 1.3}


def is_named(model: str) -> bool:
    """Whether a line has its name at its end."""
    return model in (JOINT, FINETUNE_ONLY, *_NAMED) or bool(of_role([model], "paper", "isi", "own"))


def shaded(axes: Axes, values: np.ndarray, low: np.ndarray, high: np.ndarray, color: str) -> None:
    """Draw an interval as a band."""
    if not np.isnan(low).all():
        around = np.concatenate([low, high[::-1]])
        axes.fill(np.concatenate([values, values[::-1]]), around, color=color, alpha=0.12, lw=0)


def line(
    axes: Axes, values: np.ndarray, heights: np.ndarray, model: str, models: Names, **more: Any
) -> None:
    """Draw a line with its values at the mouse."""
    shown = [
        f"{value:g}: {height:.1f}"
        for value, height in zip(values, heights, strict=True)
        if np.isfinite(height) and (len(values) <= 14 or value in _EPOCHS)
    ]
    style = style_of(model, models) | {"solid_capstyle": "round", "solid_joinstyle": "round"} | more
    (made,) = axes.plot(values, heights, label=label(model), **style)
    made.set_gid(valued(f"{label(model)} – {', '.join(shown)}"))


def valued(text: str) -> str:
    """The ``gid`` of what shows a text at the mouse."""
    return f"{_VALUE}:{text}"


def dots(axes: Axes, points: np.ndarray, size: float, color: str, **more: Any) -> None:
    """Draw points, (n, 2), as one element."""
    if not len(points):
        return
    aside = 1e-5 * max(float(np.ptp(points[:, 0])), 1e-3)  # a line without length has no dot
    ends = np.stack([points, points + np.array([aside, 0.0])], 1).reshape(-1, 2)
    path = Path(ends, np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    style = {"fill": False, "ec": color, "lw": size, "capstyle": "round", "snap": False} | more
    axes.add_patch(PathPatch(path, **style))
    axes.update_datalim(points)
    axes.autoscale_view()


def names(
    axes: Axes,
    ends: Sequence[tuple[float, str, str]],
    height: float,
    width: float,
    start: float = 1.0,
) -> None:
    """Name lines at their ends, right of a panel of about ``width`` times ``height`` pixels.

    Args:
        ends: height (data), name and colour of each; names of one colour that would overlap stand
            in one line.
        start: where lines end, as a share of the width.
    """
    low, high = axes.get_ylim()
    shares = [
        ((value - low) / (high - low), name, color) for value, name, color in ends if value == value
    ]
    gap, groups = _GAP / height, list[tuple[list[float], list[str], str]]()
    for share, name, color in sorted(shares, key=lambda end: -end[0]):
        before = next((group for group in reversed(groups) if group[2] == color), None)
        if before and before[0][-1] - share < gap:
            before[0].append(share)
            before[1].append(name)
        else:
            groups.append(([share], [name], color))
    groups.reverse()
    middles = np.array([float(np.mean(group[0])) for group in groups])
    for (_, of_group, color), middle, place in zip(
        groups, middles, spread(middles, gap), strict=True
    ):
        if abs(place - middle) > gap / 3:
            axes.plot(
                [start + 2 / width, start + 9 / width],
                [middle, place],
                color=MUTE,
                lw=0.7,
                transform=axes.transAxes,
                clip_on=False,
            )
        axes.text(
            start + 11 / width,
            place,
            ", ".join(of_group),
            color=SOFT if color == MUTE else color,
            fontsize=FONT,
            va="center_baseline",
            transform=axes.transAxes,
        )


def spread(heights: np.ndarray, gap: float) -> np.ndarray:
    """Ascending heights in [0, 1], moved as little as possible so that they are ``gap`` apart
    (less if there are many) and stay within.
    """
    steps = min(gap, 1 / max(len(heights), 1)) * np.arange(len(heights))
    if not len(heights):
        return steps
    pools = list[list[float]]()  # neighbours that would be too near move together
    for height in (heights - steps).tolist():
        pools.append([height])
        while len(pools) > 1 and np.mean(pools[-2]) > np.mean(pools[-1]):
            pools[-2:] = [pools[-2] + pools[-1]]
    apart = np.concatenate([np.full(len(pool), np.mean(pool)) for pool in pools])
    spread_out: np.ndarray = apart.clip(0, 1 - steps[-1]) + steps
    return spread_out


def in_words(axes: Sequence[Axes]) -> str:
    """What panels show: titles, and first and last value of each named line."""
    texts = []
    for panel in axes:
        lines = []
        for drawn_line in panel.get_lines():
            name, data = drawn_line.get_label(), np.asarray(drawn_line.get_xydata(), float)
            heights = data[~np.isnan(data).any(1), 1] if len(data) else data
            if len(heights) and not str(name).startswith("_"):
                start = f"from {heights[0]:.1f} to " if len(np.unique(heights)) > 1 else ""
                lines.append(f"{name} {start}{heights[-1]:.1f}")
        titles = filter(None, (panel.get_title(loc="left"), panel.get_xlabel()))
        texts.append(f"{', by '.join(titles)}: {', '.join(lines)}.")
    return " ".join(texts)


def by_size(
    runs: pd.DataFrame, models: Names, scopes: Names, measures: Names, titles: Names = ()
) -> Chart:
    """MRR* right after insertion against |ξ|: a row of panels for each measure,
    a column for each scope; ``titles``: of panels, if not those of scopes and measures.
    """
    height = 290
    listed = list(product(measures, scopes))

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, axes = panels(layout, len(listed), height)
        for number, (panel, (measure, scope)) in enumerate(zip(axes, listed, strict=True)):
            ends = []
            for model in sorted(models, key=lambda name: (is_named(name), bool(isi([name])))):
                rows = where(runs, scope=scope, model=model)
                if not len(rows):
                    continue
                sizes, mean, low, high = line_over_seeds(rows, "size", measure)
                if is_named(model) and model not in _NAMED:
                    shaded(panel, sizes, low, high, style_of(model, models)["color"])
                line(panel, sizes, mean, model, models)
                if is_named(model):
                    ends.append((mean[-1], label(model), style_of(model, models)["color"]))
            title = f"{SCOPES.get(scope, scope)}: {WORDS.get(HALVES[measure], HALVES[measure])}"
            title = titles[number] if titles else title
            framed(panel, title, "novel entities |ξ|", "MRR* (points)")
            shown = sorted(runs["size"].unique())
            panel.set_xticks(shown)
            panel.set_xlim(min(shown, default=0), max(shown, default=1) + 0.01)
            names(panel, ends, height - 90, layout.width / min(layout.columns, len(listed)) - 140)
        return canvas, in_words(axes)

    return drawn(draw)


def by_epoch(
    runs: pd.DataFrame,
    models: Names,
    scopes: Names,
    margin: float | None = None,
    ylabels: Names = ("MRR* (points)",),
) -> Chart:
    """MRR* by epoch, a panel for each scope; lines at the joint model's mean J and, if given,
    at J − ``margin``.

    The first ten epochs take about half of the width, since most changes are there; then every
    fifth is drawn.
    """
    height = 320

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, axes = panels(layout, len(scopes), height)
        for place, (panel, scope) in enumerate(zip(axes, scopes, strict=True)):
            ends = _lines(panel, where(runs, scope=scope), models, margin)
            last = int(runs["epoch"].max()) if len(runs) else 0
            panel.set_xscale("symlog", linthresh=10, linscale=1.2)
            ticks = [epoch for epoch in (0, 2, 4, 6, 8, 10, 20, 50, 150) if epoch <= last]
            panel.set_xticks(ticks, list(map(str, ticks)))
            panel.minorticks_off()
            panel.set_xlim(-0.1, max(last, 1) * 1.01)
            ylabel = ylabels[min(place, len(ylabels) - 1)]
            framed(panel, SCOPES.get(scope, scope), "epoch of fine-tuning", ylabel)
            names(panel, ends, height - 90, layout.width / min(layout.columns, len(scopes)) - 150)
        return canvas, in_words(axes)

    return drawn(draw)


def _lines(
    panel: Axes, rows: pd.DataFrame, models: Names, margin: float | None
) -> list[tuple[float, str, str]]:
    """Draw learning curves; returns their ends for ``names``."""
    shown, ends = rows[(rows["epoch"] <= 10) | (rows["epoch"] % 5 == 0)], []
    for model in sorted(models, key=lambda name: bool(isi([name]))):
        of_model = where(shown, model=model)
        if not len(of_model):
            continue
        epochs, mean, low, high = line_over_seeds(of_model, "epoch", "mrr_star")
        color = style_of(model, models)["color"]
        if of_role([model], "paper", "isi"):
            shaded(panel, epochs, low, high, color)
        line(panel, epochs, mean, model, models)
        ends.append((mean[-1], label(model), color))
    joint = 100 * shown.loc[shown["model"] == JOINT, "mrr_star"].mean()
    if joint == joint:
        style = style_of(JOINT, models)
        panel.axhline(joint, label=label(JOINT), gid=valued(f"Joint – {joint:.1f}"), **style)
        ends.append((joint, label(JOINT), INK))
        if margin is not None:
            name, level = "margin", joint - 100 * margin
            panel.axhline(level, color=SOFT, lw=1.2, ls=(0, (1, 3)), label=f"{name} of convergence")
            ends.append((level, name, SOFT))
    return ends


def named_points(points: Mapping[str, tuple[float, float]], xlabel: str, ylabel: str) -> Chart:
    """A point with its name for each initializer, which is the key."""
    height = 380

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, (axes,) = panels(layout, 1, height)
        at = {name: point for name, point in points.items() if not np.isnan(point).any()}
        for name, point in at.items():
            text = f"{label(name)} – {xlabel}: {point[0]:.1f}, {ylabel}: {point[1]:.1f}"
            dots(
                axes, np.array([point]), 10, style_of(name, list(points))["color"], gid=valued(text)
            )
        framed(axes, "", xlabel, ylabel)
        axes.grid(visible=True, axis="x", color=LINE, lw=1, alpha=1)
        axes.margins(0.06)
        _names_beside(axes, at, list(points), height - 100, layout.width - 80)
        listed = [f"{label(name)} {across:.1f}, {up:.1f}" for name, (across, up) in at.items()]
        return canvas, f"{xlabel}, then {ylabel}: {'; '.join(listed)}."

    return drawn(draw, 1)


def _names_beside(
    axes: Axes, points: Mapping[str, tuple[float, float]], models: Names, height: int, width: int
) -> None:
    """Names right of points, left of those in the right half; near ones move apart."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    shares = {
        name: ((across - left) / (right - left), (up - low) / (high - low))
        for name, (across, up) in points.items()
    }
    for side, sign in (("left", 1), ("right", -1)):
        listed = [name for name, (across, _) in shares.items() if (across > 0.6) == (sign < 0)]
        listed.sort(key=lambda name: shares[name][1])
        places = spread(np.array([shares[name][1] for name in listed]), (_GAP + 1) / height)
        for name, place in zip(listed, places, strict=True):
            color = style_of(name, models)["color"]
            axes.text(
                shares[name][0] + sign * 12 / width,
                place,
                label(name),
                color=SOFT if color == MUTE else color,
                fontsize=FONT,
                ha=side,
                va="center_baseline",
                transform=axes.transAxes,
            )


@dataclass(frozen=True)
class Bar:
    """A row of ``waterfall``: from ``start`` to ``end``, with its text and interval."""

    name: str
    start: float
    end: float
    text: str
    color: str
    interval: Estimate | None = None
    mark: bool = False  #: a dot at the end, and no bar


def waterfall(groups: Mapping[str, Sequence[Bar]], only_narrow: bool = False) -> Chart:
    """Bars one below the other, each from the end of the one before; a panel for each title."""
    rows = max(map(len, groups.values()), default=1)
    wrapped = any(len(bar.name) > _LETTERS for bars in groups.values() for bar in bars)
    height = (34 if wrapped else 27) * rows + 62

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, axes = panels(layout, len(groups), height)
        texts = []
        for panel, (title, every) in zip(axes, groups.items(), strict=True):
            bars = [bar for bar in every if np.isfinite(bar.end)]
            framed(panel, title)
            panel.grid(visible=False)
            panel.spines["bottom"].set_visible(False)
            for level, bar in enumerate(bars):
                _bar(panel, level, bar)
            panel.set_yticks(range(len(bars)), [fill(bar.name, _LETTERS) for bar in bars])
            panel.tick_params(axis="y", labelcolor=INK, labelsize=FONT)
            panel.set_xticks([])
            ends = [0.0, *(bar.end for bar in bars)]
            panel.set_xlim(min(ends), max(ends) * 1.2 + 1e-9)
            panel.set_ylim(len(bars) - 0.4, -0.6)
            listed = ", ".join(f"{bar.name} {bar.text}" for bar in bars)
            texts.append(f"{panel.get_title(loc='left')}: {listed}.")
        return canvas, " ".join(texts)

    if only_narrow:
        canvas, text = draw(FigureLayout(NARROW, 1))
        return Chart(canvas, None, text)
    return drawn(draw)


def _bar(panel: Axes, level: int, bar: Bar) -> None:
    if bar.mark:
        dots(
            panel, np.array([[bar.end, level]]), 9, bar.color, gid=valued(f"{bar.name} {bar.text}")
        )
        right = bar.end
    else:
        low, width = min(bar.start, bar.end), abs(bar.end - bar.start)
        drawn_bar = panel.barh(level, width, 0.62, low, color=bar.color)
        drawn_bar.patches[0].set_gid(valued(f"{bar.name} {bar.text}"))
        right = max(bar.start, bar.end)
    if level and not bar.mark:  # from the end of the bar above
        panel.plot([bar.start] * 2, [level - 0.69, level - 0.31], color=MUTE, lw=1)
    if bar.interval is not None and not np.isnan(bar.interval.low):
        panel.plot([bar.interval.low, bar.interval.high], [level, level], color=INK, lw=1.4)
        right = max(right, bar.interval.high)
    place: dict[str, Any] = {"textcoords": "offset points", "va": "center_baseline"}
    color = INK if bar.color in (MUTE, LINE) else bar.color
    panel.annotate(bar.text, (right, level), (8, 0), fontsize=FONT, color=color, **place)


def key(canvas: Canvas, marks: Sequence[tuple[str, float, str, str]]) -> None:
    """Name marks, each with its size, colour and filling, below all panels."""
    handles = [
        Line2D([], [], ls="", marker="o", ms=size, color=color, mfc=filling, mew=2, label=name)
        for name, size, color, filling in marks
    ]
    canvas.legend(
        handles=handles,
        loc="outside lower left",
        ncols=3,
        fontsize=FONT,
        labelcolor=INK,
        handletextpad=0.2,
        columnspacing=1.2,
        borderpad=0,
    )


def pairs(groups: Mapping[str, Mapping[str, tuple[float, float]]], sides: Names) -> Chart:
    """A panel for each title, a row for each name: a ring for the first value, a dot for the
    second; ``sides`` names both.
    """

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        columns = min(layout.columns, max(len(groups), 1))
        titles, texts = list(groups), []
        rows = [titles[place : place + columns] for place in range(0, len(titles), columns)]
        heights = [60 + 24 * max(len(groups[title]) for title in row) for row in rows] or [60]
        size = (layout.width / 72, sum(heights) / 72)
        canvas = Canvas(figsize=size, dpi=110, layout="constrained")
        canvas.get_layout_engine().set(w_pad=0.12, h_pad=0.1)  # type: ignore[union-attr, call-arg]
        places = canvas.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
        for panel in list(places.flat)[len(titles) :]:
            panel.axis("off")
        for panel, (title, listed) in zip(places.flat, groups.items(), strict=False):
            panel.set_label("")
            _pairs(panel, title, listed)
            values = [
                f"{name} {_shown(first, 'g')} and {_shown(second, '.1f')}"
                for name, (first, second) in listed.items()
            ]
            texts.append(f"{title}, {sides[0]} and {sides[1]}: {', '.join(values)}.")
        key(canvas, [(sides[0], 10, BASE, PAPER), (sides[1], 7, ISI, ISI)])
        return canvas, " ".join(texts)

    return drawn(draw)


def _pairs(panel: Axes, title: str, listed: Mapping[str, tuple[float, float]]) -> None:
    framed(panel, title)
    panel.grid(visible=False)
    panel.grid(visible=True, axis="x", color=LINE, lw=1, alpha=1)
    for level, (name, (first, second)) in enumerate(listed.items()):
        panel.plot([first, second], [level, level], color=MUTE, lw=1.4, zorder=1)
        ours, theirs = _shown(second, ".1f"), _shown(first, "g")
        text = valued(f"{name} – paper {theirs}, this run {ours}")
        if first == first:
            dots(panel, np.array([[first, level]]), 13, BASE, zorder=2, clip_on=False, gid=text)
            dots(panel, np.array([[first, level]]), 9, PAPER, zorder=3, clip_on=False)
        if second == second:
            dots(panel, np.array([[second, level]]), 7.5, ISI, zorder=4, clip_on=False, gid=text)
    panel.set_yticks(range(len(listed)), list(listed))
    panel.tick_params(axis="y", labelcolor=INK, labelsize=FONT)
    panel.set_ylim(len(listed) - 0.4, -0.6)
    values = np.array([*listed.values(), (0.0, 1.0)])
    values = values[np.isfinite(values)]
    panel.set_xlim(values.min() * 1.05, values.max() * 1.05)
    panel.locator_params(axis="x", nbins=5)


def _shown(value: float, form: str) -> str:
    """A number as text; a dash for one that there is not."""
    return f"{value:{form}}" if np.isfinite(value) else "–"


def themed(svg: str) -> str:
    """An SVG of a file whose colours are dark where it is dark."""
    light = "".join(f"--{name}:{color};" for color, (name, _) in _VARIABLES.items())
    dark = "".join(f"--{name}:{color};" for name, color in _VARIABLES.values())
    style = f"<style>svg{{{light}}}@media (prefers-color-scheme:dark){{svg{{{dark}}}}}</style>"
    return _with_values(_with_variables(svg)).replace("<defs>", f"{style}\n <defs>", 1)


def inline(svgs: Sequence[str], name: str) -> Markup:
    """Both layouts as elements of the page; ``name`` makes their ids unique within the page."""
    shown = []
    for kind, svg in zip(("wide", "narrow") if len(svgs) > 1 else ("only",), svgs, strict=True):
        body = str(figures.inline(svg, f"{name}{kind[0]}"))
        width = float(re.findall(r'viewBox="0 0 ([\d.]+) ', svg)[0])
        body = re.sub(
            r'style="min-width: \d+px"',
            f'class="{kind}" style="max-width: {1.4 * width:.0f}px"',
            body,
            count=1,
        )
        shown.append(_with_values(_with_variables(body)))
    return Markup("".join(shown))  # noqa: S704


def _with_variables(svg: str) -> str:
    def variable(color: re.Match[str]) -> str:
        known = _VARIABLES.get(color[0].lower())
        return f"var(--{known[0]})" if known else color[0]

    return re.sub(r"#[0-9a-fA-F]{6}(?=[;\"}])", variable, svg)


def _with_values(svg: str) -> str:
    """An SVG whose elements with a ``valued`` id show it at the mouse."""
    return re.sub(
        rf'<g id="(?:\w+-)?{_VALUE}:([^"]*)">',
        lambda group: f'<g class="value"><title>{group[1]}</title>',
        svg,
    )
