"""Figures as the page holds them: matplotlib's SVG without what a page has already, in colours of light and of dark."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import hypot
from xml.etree import ElementTree

from markupsafe import Markup, escape

_SVG, _LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"
#: Coordinates are kept to so many parts of a point.
_FINE = 10
#: A line may lie so many points beside where it was drawn.
_KEPT = 0.2
#: How many parameters each command of a path has, of those that matplotlib writes.
_TAKES = {"M": 2, "L": 2, "Q": 4, "C": 6, "Z": 0}
#: What a style says that is so anyway, or that the page says for all.
_USUAL = {"stroke-linejoin: round", "stroke-dasharray: none", "stroke-opacity: 1", "opacity: 1", "font-weight: normal"}
#: Ink and paper where it is dark (``style.css``).
_INK, _PAPER = (230, 232, 235), (21, 24, 28)
#: A colour stands out from dark paper by so much, as WCAG measures contrast; a grey has less colour than so much.
_CONTRAST, _GREY = 4.5, 24
#: Greys between are nearer to ink by so much where it is dark, so that they stand out as they do from white.
_FAINT = 1.6
#: What paper does anyway.
_BACKGROUND = "fill:var(--cffffff)"

Point = tuple[float, float]
#: x, y, width and height
Box = tuple[float, float, float, float]
Steps = list[tuple[str, list[Point]]]


@dataclass(frozen=True)
class _Mark:
    """Something drawn: a path, a marker at a point, or text."""

    tag: str
    style: str
    #: of the path that cuts it off; none where it is not cut
    clip: str
    #: of a path
    steps: Steps = field(default_factory=list)
    #: of others
    at: Point = (0, 0)
    #: what stands there, or the marker's name
    said: str = ""
    transform: str = ""

    @property
    def kind(self) -> tuple[str, str, str, str]:
        """Marks of one kind, beside each other, become one element."""
        return self.tag, self.style, self.clip, self.said if self.tag == "use" else ""


@dataclass(frozen=True)
class Drawing:
    """A figure in parts, so that a page sets panels beside or below each other, as there is room."""

    #: one after the other
    panels: list[Markup]
    #: how many stand beside each other where there is room
    across: int
    #: each entry's sign and name
    legend: list[tuple[Markup, str]]
    #: what it shows, in words
    words: str


def drawing(svg: str, name: str, boxes: Sequence[Box], across: int, words: str) -> Drawing:
    """A figure as the page holds it.

    Args:
        svg: by matplotlib, with all text as text.
        name: goes before its ids, which a page has once.
        boxes: what of the figure each panel takes, in points.
    """
    root = ElementTree.fromstring(svg)  # noqa: S314  # our own
    known = {one.get("id", ""): one for one in root.iter() if one.get("id")}
    within = [(group.get("id", ""), list(_marks(group, known, ""))) for group in known["figure_1"]]
    drawn = [[mark for mark in own if mark.style != _BACKGROUND] for part, own in within if part.startswith("axes_")]
    signs = [mark for part, own in within if part.startswith("legend_") for mark in own]
    marks = [mark for own in [*drawn, signs] for mark in own]
    used = dict.fromkeys(one for mark in marks for one in (mark.clip, mark.said * (mark.tag == "use")) if one)
    shapes = {one: _shape(known[one]) for one in used}
    places = {shape: f"{name}-{place}" for place, shape in enumerate(dict.fromkeys(shapes.values()))}
    names = {one: places[shape] for one, shape in shapes.items()}
    defined = "".join(shape.format(place) for shape, place in places.items())
    panels: list[Markup] = []
    for own, box in zip(drawn, boxes, strict=True):
        if own:
            parts = "".join(_drawn(list(same), names) for _, same in groupby(own, key=lambda mark: mark.kind))
            panels.append(_svg(box, parts if panels else f"<defs>{defined}</defs>{parts}"))
    return Drawing(panels, across, list(_legend(signs, names)), words)


def _svg(box: Box, drawn: str) -> Markup:
    shown = " ".join(f"{value:.1f}" for value in box)
    return Markup(f'<svg viewBox="{shown}" aria-hidden="true">{drawn}</svg>')  # noqa: S704  # of numbers and names


def _legend(marks: Sequence[_Mark], names: dict[str, str]) -> Iterator[tuple[Markup, str]]:
    """Entries row by row: of each its sign, which is drawn before its name."""
    found, sign = [], []
    for mark in marks:
        if mark.tag != "text":
            sign.append(mark)
            continue
        x, y = mark.at
        drawn = "".join(_drawn([one], names) for one in sign)
        found.append((y, x, _svg((x - 27, y - 9, 22, 12), drawn), mark.said))
        sign = []
    for _, _, drawing, said in sorted(found):
        yield drawing, said


def colours(drawings: Iterable[str]) -> list[str]:
    """Those of some figures, in the order of their names."""
    return sorted({found for drawing in drawings for found in re.findall(r"var\(--c([0-9a-f]{6})\)", drawing)})


def palette(named: Iterable[str]) -> dict[str, str]:
    """What each colour is where it is dark: greys change sides, and what has a hue is lightened till it stands out."""
    return {name: _dark(name) for name in named}


def _dark(name: str) -> str:
    colour = tuple(int(name[place : place + 2], 16) for place in (0, 2, 4))
    if max(colour) - min(colour) < _GREY:
        light = (sum(colour) / (3 * 255)) ** _FAINT
        return _hex(tuple(ink + (paper - ink) * light for ink, paper in zip(_INK, _PAPER, strict=True)))
    lighter = (tuple(part + (255 - part) * share / 20 for part in colour) for share in range(21))
    return _hex(next(one for one in lighter if _luminance(one) + 0.05 >= _CONTRAST * (_luminance(_PAPER) + 0.05)))


def _hex(colour: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(part):02x}" for part in colour)


def _luminance(colour: tuple[float, ...]) -> float:
    """Relative luminance (WCAG 2.2)."""
    parts = [part / 255 / 12.92 if part <= 10 else ((part / 255 + 0.055) / 1.055) ** 2.4 for part in colour]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]


def _marks(element: ElementTree.Element, known: dict[str, ElementTree.Element], clip: str) -> Iterator[_Mark]:
    """What an element draws; of an axis first its lines, then its text, so that marks of one kind meet."""
    clip = _reference(element.get("clip-path", "")) or clip
    tag = element.tag.removeprefix(_SVG)
    if tag in ("svg", "g"):
        own = [mark for child in element for mark in _marks(child, known, clip)]
        axis = element.get("id", "").startswith("matplotlib.axis")
        order = sorted(dict.fromkeys(mark.kind for mark in own), key=lambda kind: kind[0] == "text")
        yield from (sorted(own, key=lambda mark: order.index(mark.kind)) if axis else own)
    elif tag == "path":
        yield _Mark("path", _style(element), clip, _steps(element.get("d", "")))
    elif tag == "use":
        yield _used(element, known, clip)
    elif tag == "text":
        at = (float(element.get("x", 0)), float(element.get("y", 0)))
        turned = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}", element.get("transform", ""))
        turned = "" if turned.startswith(("rotate(-0 ", "rotate(0 ", "rotate(-0.0 ")) else turned
        yield _Mark("text", _style(element), "", at=at, said="".join(element.itertext()), transform=turned)


def _used(element: ElementTree.Element, known: dict[str, ElementTree.Element], clip: str) -> _Mark:
    """A path from elsewhere: as one of its own where it is of lines, else as a marker."""
    name, at = element.get(_LINK, "")[1:], (float(element.get("x", 0)), float(element.get("y", 0)))
    style = _style(element, known[name])
    steps = _steps(known[name].get("d", ""))
    if all(command in "MLZ" for command, _ in steps):
        moved = [(command, [(x + at[0], y + at[1]) for x, y in points]) for command, points in steps]
        return _Mark("path", style, clip, moved)
    return _Mark("use", style, clip, at=at, said=name)


def _reference(text: str) -> str:
    return text.removeprefix("url(#").removesuffix(")")


def _style(*elements: ElementTree.Element) -> str:
    """What elements say of their looks, the last word first; colours as variables of the page."""
    said = [part.strip() for element in elements for part in (element.get("style") or "").split(";")]
    kept = {part.split(":")[0]: part for part in said if part and part not in _USUAL}
    kept.pop("font-family", None)
    short = ";".join(part.replace(": ", ":") for part in kept.values())
    return re.sub(r"#([0-9a-f]{6})", r"var(--c\1)", short)


def _steps(text: str) -> Steps:
    """A path's commands with their points; all absolute, as matplotlib writes them."""
    found: Steps = []
    for command, numbers in re.findall(r"([A-Za-z])([^A-Za-z]*)", text):
        values = [float(number) for number in numbers.split()]
        if len(values) != _TAKES[command.upper()]:
            raise ValueError(f"expected {_TAKES[command.upper()]} numbers after {command}, got {len(values)}")
        found.append((command.upper(), list(zip(values[::2], values[1::2], strict=True))))
    return _thinned(found)


def _thinned(steps: Steps) -> Steps:
    """A path without the ends of lines that its neighbours tell to within what is kept."""
    found: Steps = []
    for line, run in groupby(steps, key=lambda step: step[0] == "L"):
        own = list(run)
        if line and found and found[-1][1]:
            told = _corners([found[-1][1][-1], *(points[0] for _, points in own)])[1:]
            own = [("L", [point]) for point in told]
        found += own
    return found


def _corners(points: list[Point]) -> list[Point]:
    """Of a line through many points, those without which it would be elsewhere (Douglas and Peucker, 1973)."""
    if len(points) < 3:
        return points
    (x, y), (last_x, last_y) = points[0], points[-1]
    across, up = last_x - x, last_y - y
    square = across**2 + up**2

    def aside(point: Point) -> float:
        """How far from the straight line between both ends."""
        over, above = point[0] - x, point[1] - y
        along = min(max((over * across + above * up) / square, 0), 1) if square else 0
        return hypot(over - along * across, above - along * up)

    far = max(range(1, len(points) - 1), key=lambda place: aside(points[place]))
    if aside(points[far]) <= _KEPT:
        return [points[0], points[-1]]
    return [*_corners(points[: far + 1])[:-1], *_corners(points[far:])]


def _path(steps: Steps) -> str:
    """A path in few characters: relative, to a tenth of a point, without lines that lead nowhere."""
    x, y, start, written, before = 0, 0, (0, 0), [], ""
    for command, points in steps:
        ends = [(round(_FINE * px), round(_FINE * py)) for px, py in points]
        if command == "L" and ends == [(x, y)] and before == "l":
            continue
        numbers = [number for px, py in ends for number in (px - x, py - y)]
        sign = command.lower()
        written.append(("" if sign == before and sign != "m" else sign) + _numbers(numbers, sign == before))
        before = sign
        x, y = ends[-1] if ends else start
        start = (x, y) if command == "M" else start
    return "".join(written)


def _numbers(values: Iterable[int], go_on: bool = False) -> str:
    """Tenths, with spaces only where they are needed."""
    text = ""
    for value in values:
        number = f"{value / _FINE:g}".replace("0.", ".", 1) if abs(value) < _FINE and value else f"{value / _FINE:g}"
        text += (" " if (text or go_on) and not number.startswith("-") else "") + number
    return text


def _shape(element: ElementTree.Element) -> str:
    """A marker or what cuts off, with a place for its name."""
    if element.tag == f"{_SVG}path":
        return f'<path id="{{}}" d="{_path(_steps(element.get("d", "")))}"/>'
    (shape,) = element
    places = " ".join(f'{key}="{float(shape.get(key, 0)):g}"' for key in ("x", "y", "width", "height"))
    return f'<clipPath id="{{}}"><rect {places}/></clipPath>'


def _drawn(marks: list[_Mark], names: dict[str, str]) -> str:
    """Marks of one kind as one element."""
    first = marks[0]
    style = f' style="{first.style}"' if first.style else ""
    clip = f' clip-path="url(#{names[first.clip]})"' if first.clip else ""
    if first.tag == "path":
        # what is filled may lie upon its like, so it stays by itself
        lines = "fill:none" in first.style or all(len(mark.steps) == 2 for mark in marks)
        parts = [marks] if lines else [[mark] for mark in marks]
        paths = (_path([step for mark in part for step in mark.steps]) for part in parts)
        return "".join(f'<path{clip}{style} d="{path}"/>' for path in paths)
    if first.tag == "use":
        each = "".join(f'<use href="#{names[mark.said]}" x="{mark.at[0]:.1f}" y="{mark.at[1]:.1f}"/>' for mark in marks)
        return f"<g{clip}{style}>{each}</g>"
    return f"<g{style}>{''.join(map(_text, marks))}</g>"


def _text(mark: _Mark) -> str:
    turned = f' transform="{mark.transform}"' if mark.transform else ""
    return f'<text x="{mark.at[0]:.1f}" y="{mark.at[1]:.1f}"{turned}>{escape(mark.said)}</text>'
