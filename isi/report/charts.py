"""Figures: each panel is one drawing of ``WIDTH`` pixels, with its values for the pointer.

A point of a canvas is a pixel of the page, so ``FONT`` is the size of text there. A name has one
colour, dash and mark in all figures of all pages (``palette.yaml``).
"""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.lines import Line2D
from scipy.optimize import isotonic_regression

from isi import config

WIDTH, HEIGHT, FONT = 430, 300, 12.5  #: In pixels.
_TOP, _BOTTOM = 44, 46  #: Margins of a panel in pixels.
INK, SOFT, LINE, PAPER = "#1b1e23", "#5c6470", "#d9dde3", "#ffffff"
#: Colours that the page's style sets, light or dark.
_VARIABLES = {INK: "ink", SOFT: "soft", LINE: "line", PAPER: "paper"}
#: Colours of the part of ISI itself, and of what has no name of its own.
ISI_COLOUR, MUTE = "#d1491b", "#8a919c"
PALETTE = config.read(Path(__file__).with_name("palette.yaml"))
#: Labels of the axis below lines, by column.
XLABELS = {
    "epoch": "epoch of fine-tuning",
    "indicators": "indicators k",
    "size": "novel entities |ξ|",
}
#: Initializers whose lines have a band: the paper's.
BANDED = ("Xavier", "IU", "ES", "RS", "ERS")
#: Colours of names that the palette lacks, in order of their appearance.
_SPARE = ("#8c564b", "#5f8f2f", "#b04a5a", "#4f86a8", "#94752c", "#7d5fa5")
_DASHES = {"-": "-", "--": (0, (5, 2.5)), ":": (0, (1.2, 2)), "-.": (0, (6, 2, 1.2, 2))}
_SOLID = {"ls": "-"}  #: In place of the dashes of a style, where a point alone is drawn.
_SETTINGS: Any = {
    "font.size": FONT,
    "svg.fonttype": "none",
    "svg.hashsalt": "isi",
    "path.simplify": True,
    "axes.unicode_minus": True,
    "font.family": "DejaVu Sans",
    "text.parse_math": False,  # names may have dollar signs
}
#: Between names at the ends of lines, in pixels.
_GAP = 15


@dataclass
class Panel:
    """A drawing, and the values at its points: x, y (pixels from the upper left), name, value."""

    canvas: Figure
    axes: Axes
    title: str
    by: str = "x"  #: the coordinate that points share which are shown together
    points: list[tuple[float, float, str, str]] = field(default_factory=list)

    def add(self, x: Any, y: Any, name: str, text: str) -> None:
        """Show a value at a place in data coordinates."""
        self.points.append((float(x), float(y), name, text))

    def values(self) -> dict[str, Any]:
        """The values as JSON for the page's script, in pixels."""
        width, height = (72 * side for side in self.canvas.get_size_inches())
        places = np.array([point[:2] for point in self.points]).reshape(-1, 2)
        pixels = self.axes.transData.transform(places) * 72 / self.canvas.dpi
        rows = [
            [round(x), round(height - y), name, text]
            for (x, y), (_, _, name, text) in zip(pixels.tolist(), self.points, strict=True)
        ]
        return {"by": self.by, "width": round(width), "height": round(height), "points": rows}


def style_of(name: str, names: Sequence[str] = ()) -> dict[str, Any]:
    """Colour, dashes and mark of a name."""
    known = PALETTE["models"].get(name) or PALETTE["models"].get(name.split(",")[0])
    if known is None:
        unknown = [other for other in names if other not in PALETTE["models"]]
        place = unknown.index(name) if name in unknown else 0
        known = [_SPARE[place % len(_SPARE)], "-", "o"]
    colour, dash, mark = known
    return {"color": INK if colour == "ink" else colour, "ls": _DASHES[dash], "marker": mark}


def panel(
    title: str, xlabel: str, ylabel: str = "", height: int = HEIGHT, left: int = 46,
    right: int = 104,
) -> Panel:  # fmt: skip
    """An empty panel: lines across, and no frame but below; ``left``, ``right``: margins."""
    canvas = Figure(figsize=(WIDTH / 72, height / 72), dpi=110)
    width, tall = WIDTH - left - right, height - _TOP - _BOTTOM
    axes = canvas.add_axes((left / WIDTH, _BOTTOM / height, width / WIDTH, tall / height))
    axes.grid(visible=True, axis="y", color=LINE, lw=1)
    axes.set_axisbelow(True)
    axes.spines[["left", "top", "right"]].set_visible(False)
    axes.spines["bottom"].set(color=SOFT, lw=1)
    axes.tick_params(length=0, pad=5, labelsize=FONT - 0.5, labelcolor=SOFT)
    canvas.text(2 / WIDTH, 1 - 17 / height, title, fontsize=FONT + 0.5, color=INK, weight="bold")
    canvas.text(2 / WIDTH, 1 - 36 / height, ylabel, fontsize=FONT - 0.5, color=SOFT)
    axes.set_xlabel(xlabel, loc="left", fontsize=FONT - 0.5, color=SOFT, labelpad=5)
    return Panel(canvas, axes, title)


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
    made = panel(title, XLABELS[x], ylabel)
    name = "model" if "model" in frame else "initializer"
    axes, names = made.axes, list(dict.fromkeys(frame[name]))
    ends = list[tuple[float, str]]()
    for each in names:
        rows = frame[frame[name] == each].dropna(subset=y)
        if rows.empty:
            continue
        style = style_of(each, names)
        at, height = rows[x].to_numpy(float), rows[y].to_numpy(float)
        if each in BANDED and f"{y} low" in rows:
            low, high = rows[f"{y} low"].to_numpy(float), rows[f"{y} high"].to_numpy(float)
            axes.fill_between(at, low, high, color=style["color"], alpha=0.13, lw=0)
        wide = 2.2 if each in ("ERS", "Xavier") else 1.5
        axes.plot(at, height, **style | {"marker": ""}, lw=wide)
        few = _marked(at)
        axes.plot(at[few], height[few], **style | {"ls": ""}, ms=5)
        ends.append((height[-1], each))
        for place, value in zip(at, height, strict=True):
            made.add(place, value, each, f"{value:.1f}")
    if level and not np.isnan(level[1]):
        axes.axhline(level[1], color=SOFT, lw=1.2, ls=_DASHES[":"])
        ends.append((level[1], level[0]))
    if len(frame):
        low, high = float(frame[x].min()), float(frame[x].max())
        if high > 20 and low == 0:
            _widen_the_start(axes, high)
        axes.set_xlim(low, high if high > low else low + 1)
    _name_ends(made, ends, names)
    return made


def _widen_the_start(axes: Axes, high: float) -> None:
    """Scale x linearly to 10 and by its logarithm from there; a line says so."""
    axes.set_xscale("symlog", linthresh=10, linscale=1.2)
    ticks = [tick for tick in (0, 2, 4, 6, 8, 10, 20, 50, 150) if tick <= high]
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.minorticks_off()
    axes.axvline(10, color=LINE, lw=1, zorder=0.5)
    at_top = axes.get_xaxis_transform()
    axes.text(10.4, 0.97, "scale changes", fontsize=FONT - 3, color=SOFT, transform=at_top)


def _marked(at: np.ndarray) -> np.ndarray:
    """About six places of a line that get its mark."""
    if len(at) <= 12:
        return np.arange(len(at))
    wanted = [0, 2, 5, 10, 20, 50, 100, 150]
    return np.flatnonzero(np.isin(at, wanted))


def _name_ends(made: Panel, ends: Sequence[tuple[float, str]], names: Sequence[str]) -> None:
    """Name lines right of the panel, with a piece of the line before each name."""
    axes = made.axes
    if not ends:
        return
    low, high = axes.get_ylim()
    height, width = _height(made), axes.get_position().width * WIDTH
    shares = sorted(((value - low) / (high - low), name) for value, name in ends)
    places = spread(np.array([share for share, _ in shares]), _GAP / height)
    for (share, name), place in zip(shares, places.tolist(), strict=True):
        style = style_of(name, names) if name in names else {"color": SOFT, "ls": ":", "marker": ""}
        start = np.array([1 + 2 / width, 1 + 7 / width])
        anywhere: dict[str, Any] = {"transform": axes.transAxes, "clip_on": False}
        if abs(place - share) * height > 3:
            axes.plot(start, [share, place], color=LINE, lw=1, **anywhere)
        piece = np.array([1 + 8 / width, 1 + 22 / width])
        axes.plot(piece, [place] * 2, **style | {"marker": ""}, lw=1.6, **anywhere)
        axes.plot(piece.mean(), place, **style | _SOLID, ms=4.5, **anywhere)
        axes.text(1 + 26 / width, place, _short(name), color=INK, fontsize=FONT - 1,
                  va="center_baseline", transform=axes.transAxes)  # fmt: skip


def _height(made: Panel) -> float:
    """The height of a panel's axes in pixels."""
    height: float = made.axes.get_position().height * made.canvas.get_size_inches()[1] * 72
    return height


def _short(name: str) -> str:
    return {
        "Nothing inserted": "None inserted",
        "MAP, own facts": "MAP, own",
    }.get(name, name)


def spread(heights: np.ndarray, gap: float) -> np.ndarray:
    """Ascending heights in [0, 1], moved as little as possible so that they are ``gap`` apart
    (less if there are many) and stay within.
    """
    steps = min(gap, 1 / max(len(heights), 1)) * np.arange(len(heights))
    apart = isotonic_regression(heights - steps).x  # neighbours too near move together
    placed: np.ndarray = apart.clip(0, 1 - steps[-1]) + steps
    return placed


def dots(
    frame: pd.DataFrame,
    row: str,
    columns: Mapping[str, str],
    title: str,
    *,
    xlabel: str,
    left: int = 150,
) -> Panel:
    """A row for each value of ``row``, from above; a dot for each column (name to column), with its
    interval if there is one.
    """
    frame = frame.dropna(how="all", subset=list(columns.values()))
    made = panel(title, xlabel, height=104 + 21 * max(len(frame), 1), left=left, right=24)
    made.by, axes = "y", made.axes
    heights = -np.arange(len(frame), dtype=float)
    shift = np.linspace(0.16, -0.16, len(columns)) if len(columns) > 1 else [0.0]
    labels, alone = list(map(str, frame[row])), len(columns) == 1
    for (name, column), move in zip(columns.items(), shift, strict=True):
        lows, highs = (frame.get(f"{column} {end}", frame[column]) for end in ("low", "high"))
        for value, low, high, height, label in zip(
            frame[column], lows, highs, heights, labels, strict=True
        ):
            style = style_of(label, labels) if alone else style_of(name, list(columns))
            axes.hlines(height + move, low, high, color=style["color"], lw=1.6, alpha=0.7)
            axes.plot(value, height + move, **style | _SOLID, ms=6)
            if value == value:
                made.add(value, height, label if alone else f"{label}, {name}", f"{value:.1f}")
    axes.grid(visible=False)
    axes.grid(visible=True, axis="x", color=LINE, lw=1)
    axes.hlines(heights, *axes.get_xlim(), color=LINE, lw=0.7, zorder=0.5)
    axes.set_yticks(heights, labels)
    for text in axes.get_yticklabels():
        text.set_color(INK)
    axes.set_ylim(-len(frame) + 0.4, 0.6)
    if len(columns) > 1:
        _key(made, list(columns))
    return made


def _key(made: Panel, names: Sequence[str]) -> None:
    """A row of marks with their names above a panel."""
    x, height = 2.0, made.canvas.get_size_inches()[1] * 72
    for name in names:
        style = style_of(name, names)
        mark = Line2D([(x + 6) / WIDTH], [1 - 32 / height], **style | {"ls": ""}, ms=6)
        made.canvas.add_artist(mark)
        made.canvas.text((x + 14) / WIDTH, 1 - 36 / height, name, fontsize=FONT - 1, color=INK)
        x += 24 + 6.6 * len(name)


def bars(frame: pd.DataFrame, title: str) -> Panel:
    """Bars from ``start`` to ``end`` below each other, and a mark where both are equal."""
    made = panel(title, "MRR (points)", height=104 + 24 * len(frame), left=120, right=50)
    made.by, axes = "y", made.axes
    axes.grid(visible=False)
    for place, row in enumerate(frame.to_dict("records")):
        part, start, end = str(row["part"]), float(row["start"]), float(row["end"])
        style, change, height = style_of(part), end - start, -float(place)
        if change:
            of_part = ISI_COLOUR if "words" in part else MUTE
            colour = style["color"] if start == 0 else of_part
            axes.barh(height, change, left=start, height=0.62, color=colour)
            text = f"{end:.1f}" if start == 0 else f"{change:+.1f}".replace("-", "−")
        else:
            axes.plot(end, height, **style | _SOLID, ms=8)
            text = f"{end:.1f}"
        place_of = (max(start, end), height)
        axes.annotate(
            text, place_of, (6, 0), textcoords="offset points", va="center_baseline",
            fontsize=FONT - 0.5, color=INK,
        )  # fmt: skip
        made.add(end, height, part, text)
    axes.set_yticks(-np.arange(len(frame)), list(map(str, frame["part"])))
    for text_of in axes.get_yticklabels():
        text_of.set_color(INK)
    axes.set_xlim(left=0)
    axes.set_ylim(-len(frame) + 0.3, 0.7)
    return made


def places(frame: pd.DataFrame, title: str, mean: float) -> Panel:
    """A map of vectors: known entities, the indicators of one initializer, and the path of the new
    entity from its start (mark) to its end (ring); ``mean``: distance of known vectors on average.
    """
    made = panel(title, "distance from the centre", "first principal axis", height=320, right=24)
    axes = made.axes
    known = frame[frame["what"] == "known entity"]
    axes.plot(known["distance"], known["axis"], color="#8a919c", marker="o", ms=3, ls="", alpha=0.6)
    axes.axvline(mean, color=SOFT, lw=1, ls=_DASHES[":"])
    for name, rows in frame[frame["what"] != "known entity"].groupby("initializer", sort=False):
        style = style_of(str(name))
        colour, mark = style["color"], dict[str, Any](ls="", mec=INK)
        chosen, path = rows[rows["what"] == "indicator"], rows[rows["what"] == "path"]
        axes.plot(chosen["distance"], chosen["axis"], color=colour, marker="o", ms=5, ls="")
        axes.plot(path["distance"], path["axis"], color=colour, lw=1.4)
        first, last = path[["distance", "axis"]].to_numpy()[[0, -1]]
        axes.plot(*first, **style | mark, ms=9)
        axes.plot(*last, marker="o", ms=8, mfc="none", **mark)
        axes.annotate(str(name), first, (8, 6), fontsize=FONT - 1, textcoords="offset points",
                      color=INK)  # fmt: skip
        made.add(first[0], first[1], f"{name}, start", f"{first[0]:.1f}")
        made.add(last[0], last[1], f"{name}, end", f"{last[0]:.1f}")
    axes.set_xlim(left=0)
    return made


# Files


def drawn(draw: Callable[[pd.DataFrame], list[Panel]], frame: pd.DataFrame) -> list[Panel]:
    """The panels of a figure, drawn with the settings of all figures."""
    with mpl.rc_context(_SETTINGS):
        return draw(frame)


def svg(made: Panel, name: str) -> str:
    """A panel as an SVG element whose ids start with ``name``; colours follow the page's style."""
    buffer = io.StringIO()
    with mpl.rc_context(_SETTINGS):
        made.canvas.savefig(
            buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
        )
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var(--{variable}, {colour})")
    return _short_svg(text, name)


#: What a drawing can do without: pattern and replacement, in order.
_SHORTER = (
    (r'<g id="[^"]*">', "<g>"),
    (r'<path d="[^"]*" style="fill: none"/>', ""),
    (r'<g>\s*</g>|<g/>|<g id="[^"]*"/>', ""),
    (r" *font-family: 'DejaVu Sans';", ""),
    (r' transform="rotate\(-0 [^"]*"', ""),
    (r"; stroke-dashoffset: 0", ""),
    (r'(width|height)="([\d.]+)pt"', r'\1="\2"'),
    (r"\s*\n\s*", "\n"),
    (r"<g>\s*</g>\n", ""),
    (r"; stroke-linejoin: miter|; stroke-linecap: square", ""),
)


def _short_svg(text: str, name: str) -> str:
    """The same drawing in fewer characters; ids start with ``name``."""
    text = re.sub(r"-?\d+\.\d{2,}", lambda number: f"{float(number[0]):.1f}", text)
    for pattern, shorter in _SHORTER:
        text = re.sub(pattern, shorter, text)
    text = re.sub(r'(?<= d=")[^"]*', lambda path: " ".join(path[0].split()), text)
    marks = r'(<g clip-path="[^"]*")>\n((?:<use [^>]*/>\n)+)</g>'
    text = re.sub(marks, _styled_once, text)
    return re.sub(r'(\bid="|url\(#|href="#)', rf"\1{name}-", text)


def _styled_once(group: re.Match[str]) -> str:
    """A group of marks of one style, which it says once."""
    styles = set(re.findall(r'style="([^"]*)"', group[2]))
    if len(styles) != 1:
        return group[0]
    uses = re.sub(r' style="[^"]*"', "", group[2])
    return f'{group[1]} style="{styles.pop()}">\n{uses}</g>'


def _layout(sizes: Sequence[tuple[Any, Any]]) -> tuple[list[tuple[Any, Any]], Any, Any]:
    """Places (x, y) of panels of some sizes (width, height), two in a row; width and height of
    all.
    """
    places, y = list[tuple[Any, Any]](), 0
    for start in range(0, len(sizes), 2):
        row = sizes[start : start + 2]
        places += [(place * row[0][0], y) for place in range(len(row))]
        y += max(height for _, height in row)
    return places, sum(width for width, _ in sizes[:2]), y


def joined(svgs: Sequence[str], made: Sequence[Panel]) -> str:
    """The panels of a figure in one SVG file."""
    sizes = [(WIDTH, 72 * panel.canvas.get_figheight()) for panel in made]
    places, width, height = _layout(sizes)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'viewBox="0 0 {width} {height:.0f}" font-family="DejaVu Sans, sans-serif">'
        f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    )
    parts = [
        text.replace("<svg ", f'<svg x="{x}" y="{y:.0f}" ', 1)
        for text, (x, y) in zip(svgs, places, strict=True)
    ]
    return "\n".join([head, *parts, "</svg>\n"])


def png(made: Sequence[Panel]) -> bytes:
    """The panels of a figure in one PNG file."""
    images = list[np.ndarray]()
    with mpl.rc_context(_SETTINGS):
        for each in made:
            agg = FigureCanvasAgg(each.canvas)
            agg.draw()  # type: ignore[no-untyped-call]
            images.append(np.asarray(agg.buffer_rgba()))  # type: ignore[no-untyped-call]
    places, width, height = _layout([(image.shape[1], image.shape[0]) for image in images])
    whole = np.full((height, width, 4), 255, np.uint8)
    for image, (x, y) in zip(images, places, strict=True):
        whole[y : y + image.shape[0], x : x + image.shape[1]] = image
    buffer = io.BytesIO()
    imsave(buffer, whole, format="png", dpi=110, metadata={"Software": ""})
    return buffer.getvalue()
