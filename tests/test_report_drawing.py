"""Figures as the page holds them."""

from __future__ import annotations

import re
from itertools import pairwise
from math import hypot

import matplotlib as mpl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.report import drawing, figures
from isi.report.drawing import Drawing, Point, colours, palette
from tests.reports import runs


def drawn(name: str = "f0", title: str = "a < b") -> Drawing:
    """Two panels of three lines each, with a second axis above and a legend below."""
    rows = runs([(model, scope, size, seed, 0, 0.2 + size / 10 + seed / 20) for model in ("xavier", "es", "joint")
                 for scope in ("all", "novel") for size in (1, 2) for seed in (0, 1)])  # fmt: skip
    with mpl.rc_context(figures.STYLE):
        canvas = figures.by_size(rows, ["xavier", "es", "joint"], ("all", "novel"), ("mrr_star",), entities=50)
        canvas.axes[0].set_title(title)
    svg = figures.rendered(canvas, "svg").decode()
    boxes, across = figures.boxes(canvas)
    return drawing.drawing(svg, name, boxes, across, figures.in_words(canvas))


def test_a_figure_comes_panel_by_panel_with_its_legend_apart() -> None:
    found = drawn()
    assert (len(found.panels), found.across) == (2, 2)
    assert [name for _, name in found.legend] == ["Xavier", "ES", "Joint"]
    first, second = found.panels
    assert "a &lt; b" in first
    assert "a &lt; b" not in second
    assert "novel entities: MRR*" in second
    assert not any("Xavier" in panel for panel in found.panels)
    width = [float(panel.split('viewBox="')[1].split()[2]) for panel in found.panels]
    assert width[0] == width[1]


def test_a_blank_panel_is_none() -> None:
    with mpl.rc_context(figures.STYLE):
        canvas, panels = figures.panels(3)
        for panel in panels:
            panel.plot([0, 1], [2, 3])
    svg = figures.rendered(canvas, "svg").decode()
    assert len(drawing.drawing(svg, "f0", *figures.boxes(canvas), "").panels) == 3


def test_what_is_drawn_lies_within_its_panel() -> None:
    for panel in drawn().panels:
        x, y, width, height = map(float, re.findall(r'viewBox="([^"]+)"', panel)[0].split())
        for across, down in re.findall(r'<text x="([^"]+)" y="([^"]+)"', panel):
            assert x <= float(across) <= x + width
            assert y <= float(down) <= y + height


def test_figures_share_no_ids_and_what_they_refer_to_is_there() -> None:
    one, other = ("".join([*found.panels, *(sign for sign, _ in found.legend)]) for found in (drawn("f0"), drawn("f1")))
    ids = [re.findall(r' id="([^"]+)"', text) for text in (one, other)]
    assert len(set(ids[0])) == len(ids[0])
    assert not set(ids[0]) & set(ids[1])
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', one)) <= set(ids[0])


def test_all_colours_are_variables_that_change_sides_where_it_is_dark() -> None:
    found = drawn()
    text = "".join([*found.panels, *(sign for sign, _ in found.legend)])
    assert not re.search(r"[:\"]#[0-9a-f]{6}", text)
    dark = palette(colours([text]))
    assert dark["000000"] == "#e6e8eb"
    assert {"999999", "0072b2", "b0b0b0"} <= set(dark)
    paper = (21, 24, 28)
    for name in ("0072b2", "b2182b", "8c2d04", "e69f00"):
        shown = palette([name])[name]
        parts = tuple(int(shown[place : place + 2], 16) for place in (1, 3, 5))
        lighter, darker = (drawing._luminance(colour) + 0.05 for colour in (parts, paper))
        assert lighter / darker >= 4.4
    assert palette(["e69f00"])["e69f00"] == "#e69f00"  # which stands out as it is


def test_a_figure_is_told_in_its_own_numbers() -> None:
    lines = "across: novel entities |ξ|; up: points. " + ", ".join(
        f"{name} from 32.5 to 42.5" for name in ("Xavier", "ES", "Joint")
    )
    assert drawn().words == f"A < b; {lines}. Novel entities: MRR*; {lines}."


def test_paths_are_relative_and_round_without_drifting() -> None:
    steps = [("M", [(1.0, 1.0)]), ("L", [(2.0, 1.0)]), ("L", [(2.0, 3.25)]), ("Z", [])]
    assert drawing._path(steps) == "m1 1l1 0 0 2.2z"
    many = [("M", [(0.0, 0.0)])] + [("L", [(0.04 * n, float(n % 2))]) for n in range(1, 101)]
    across = re.findall(r"-?[\d.]+", drawing._path(many))[::2]
    assert sum(map(float, across)) == pytest.approx(4)


def test_lines_keep_their_corners_and_lose_what_lies_between() -> None:
    straight = [(float(x), 0.0) for x in range(50)]
    assert drawing._corners([*straight, (49.0, 30.0)]) == [(0, 0), (49, 0), (49, 30)]
    assert drawing._corners([(0, 0), (5, 5), (0, 0)]) == [(0, 0), (5, 5), (0, 0)]  # there and back
    assert drawing._corners([(0, 0), (9, 0), (5, 0)]) == [(0, 0), (9, 0), (5, 0)]  # and not all the way


@given(st.lists(st.tuples(st.floats(0, 100), st.floats(0, 100)), min_size=2, max_size=12))
def test_no_point_of_a_line_is_far_from_what_is_kept(points: list[Point]) -> None:
    kept = drawing._corners(points)
    assert kept[0] == points[0]
    assert kept[-1] == points[-1]
    ends = list(pairwise(kept))
    assert all(min(_away(point, *both) for both in ends) <= drawing._KEPT + 0.4 for point in points)


def _away(point: Point, first: Point, last: Point) -> float:
    """How far a point is from the nearest of many that lie evenly between two others."""
    between = [(first[0] + (last[0] - first[0]) * share / 400, first[1] + (last[1] - first[1]) * share / 400)
               for share in range(401)]  # fmt: skip
    return min(hypot(point[0] - x, point[1] - y) for x, y in between)
