"""Figures within the page: matplotlib's SVG in colours that change sides where it is dark."""

from __future__ import annotations

import re
from collections.abc import Iterable

from markupsafe import Markup

#: Ink and paper where it is dark (``style.css``).
_INK, _PAPER = (230, 232, 235), (21, 24, 28)
#: Contrast (WCAG 2.2) in which a colour stands out from dark paper; parts of a grey differ by less than ``_GREY``.
_CONTRAST, _GREY = 4.5, 24
#: Greys are nearer to ink by this power where it is dark, so that they stand out as from white.
_FAINT = 1.6
_COLOUR = re.compile(r"#([0-9a-f]{6})\b")

Colour = tuple[float, ...]


def rounded(svg: str) -> str:
    """A figure with coordinates to a hundredth of a point: it does not change with the last bit of a number."""

    def shorter(attribute: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", attribute[0])

    hashed = dict.fromkeys(re.findall(r' id="((?:C\w+_|[mp])[\da-f]{10})"', svg))  # of coordinates in full
    names = {name: f"i{number}" for number, name in enumerate(hashed)}
    svg = re.sub(r'(?<=[#"])(?:C\w+_|[mp])[\da-f]{10}(?=[)"])', lambda name: names.get(name[0], name[0]), svg)
    return re.sub(r' (?:d|x|y|width|height|transform)="[^"]*"', shorter, svg)


def inline(svg: str, name: str) -> Markup:
    """A figure as an element of the page.

    Args:
        svg: by matplotlib, with text as text.
        name: stands before its ids, each of which a page has once.
    """
    text = re.sub(r"<metadata>.*?</metadata>|<style .*?</style>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    text = re.sub(r' id="', f' id="{name}-', text)
    text = re.sub(r'(url\(#|(?:xlink:)?href="#)', lambda start: f"{start[0].removeprefix('xlink:')}{name}-", text)
    text = _COLOUR.sub(r"var(--c\1)", text)
    width = float(re.findall(r'viewBox="0 0 ([\d.]+)', text)[0])
    start = f'<svg aria-hidden="true" style="min-width: {0.9 * width:.0f}px"'
    return Markup(start + re.sub(r' (?:width|height|xmlns[:\w]*|version)="[^"]*"', "", text[4:], count=5))  # noqa: S704


def colours(figures: Iterable[str]) -> dict[str, str]:
    """The colours of figures in the page, each with what it is where it is dark."""
    names = {name for figure in figures for name in re.findall(r"var\(--c([0-9a-f]{6})\)", figure)}
    return {name: dark(name) for name in sorted(names)}


def dark(name: str) -> str:
    """A colour where it is dark: greys change sides, and what has a hue is lightened until it stands out."""
    colour = tuple(int(name[place : place + 2], 16) for place in (0, 2, 4))
    if max(colour) - min(colour) < _GREY:
        light = (sum(colour) / (3 * 255)) ** _FAINT
        return _hex(tuple(ink + (paper - ink) * light for ink, paper in zip(_INK, _PAPER, strict=True)))
    lighter = (tuple(part + (255 - part) * share / 20 for part in colour) for share in range(21))
    paper = luminance(_PAPER) + 0.05
    return _hex(next(shade for shade in lighter if luminance(shade) + 0.05 >= _CONTRAST * paper))


def _hex(colour: Colour) -> str:
    return "#" + "".join(f"{round(part):02x}" for part in colour)


def luminance(colour: Colour) -> float:
    """Relative luminance (WCAG 2.2)."""
    parts = [part / 255 / 12.92 if part <= 10 else ((part / 255 + 0.055) / 1.055) ** 2.4 for part in colour]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]
