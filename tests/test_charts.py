"""Figures of the main page: both layouts, names at the ends of lines, values at the mouse."""

import re
from io import BytesIO
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from isi.report import charts, figures
from isi.report.charts import NARROW, WIDE, Bar
from isi.report.figures import Chart, rendered
from tests.reports import runs

ROWS = [
    (model, scope, size, seed, 0, level + size / 10 + seed / 50)
    for model, level in (("xavier", 0.2), ("es", 0.5), ("rs", 0.5), ("joint", 0.7), ("iu", 0.3))
    for scope in ("all", "novel")
    for size in (1, 2)
    for seed in (0, 1)
]
MODELS = ["xavier", "iu", "es", "rs", "joint"]


def sized() -> Chart:
    with mpl.rc_context(figures.STYLE):
        return charts.by_size(runs(ROWS), MODELS, ("all", "novel"), ("mrr_star",))


def svgs(chart: Chart) -> list[str]:
    assert chart.narrow
    return [rendered(canvas, "svg").decode() for canvas in (chart.wide, chart.narrow)]


def test_panels_stand_side_by_side_or_one_below_the_other() -> None:
    chart = sized()
    assert chart.narrow
    assert [canvas.get_size_inches()[0] * 72 for canvas in (chart.wide, chart.narrow)] == [
        pytest.approx(WIDE),
        pytest.approx(NARROW),
    ]
    wide, narrow = chart.wide.axes, chart.narrow.axes
    assert wide[0].get_position().y0 == pytest.approx(wide[1].get_position().y0)
    assert narrow[0].get_position().y0 > narrow[1].get_position().y0
    for axes in (wide, narrow):
        titles = [panel.get_title(loc="left") for panel in axes]
        assert titles == ["(a) All queries: MRR*", "(b) Novel entities: MRR*"]


def test_lines_are_named_at_their_ends_and_equal_ends_share_a_line() -> None:
    texts = [text.get_text() for text in sized().wide.axes[0].texts]
    assert set(texts) == {"MRR* (points)", "ES, RS", "Joint", "Xavier", "IU"}


def test_values_are_titles_and_colours_variables_in_page_and_file() -> None:
    page = str(charts.inline(svgs(sized()), "f0"))
    file = charts.themed(svgs(sized())[0])
    for text in (page, file):
        assert "<title>ES – 1: 61.0, 2: 71.0</title>" in text
        assert "var(--isi)" in text
        assert not re.search(r"(?:fill|stroke): #(?!ffffff)", text.split("</style>", 1)[1])
    assert "prefers-color-scheme:dark" in file
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(set(ids)) == len(ids)
    assert re.findall(r'class="(wide|narrow)"', page) == ["wide", "narrow"]


def test_equal_values_give_equal_bytes() -> None:
    assert svgs(sized()) == svgs(sized())


def test_points_are_one_element() -> None:
    canvas, (panel,) = charts.panels(charts.FigureLayout(NARROW, 1), 1, 200)
    points = np.random.default_rng(0).uniform(size=(500, 2))
    charts.dots(panel, points, 5, charts.MUTE)
    (drawn,) = panel.patches
    assert len(drawn.get_path().vertices) == 1000
    assert panel.get_xlim()[0] <= points[:, 0].min() < points[:, 0].max() <= panel.get_xlim()[1]
    assert rendered(canvas, "svg").count(b"<path") < 20


def test_bars_of_a_waterfall_have_their_names_and_values() -> None:
    bars = [Bar("Xavier", 0, 10, "10.0", charts.BASE), Bar("centre", 10, 15, "+5.0", charts.MUTE)]
    chart = charts.waterfall({"all queries": bars})
    assert chart.words == "All queries: Xavier 10.0, centre +5.0."
    (panel,) = chart.wide.axes
    assert [bar.get_x() for bar in panel.patches] == [0, 10]
    assert [text.get_text() for text in panel.texts] == ["10.0", "+5.0"]


@pytest.mark.parametrize("values", [(1.0, 2.0), (float("nan"), 2.0), (1.0, float("nan"))])
def test_pairs_show_what_is_there(values: tuple[float, float]) -> None:
    chart = charts.pairs({"epochs": {"Xavier": values}}, ("paper", "this run"))
    rings = [patch.get_edgecolor() for patch in chart.wide.axes[0].patches]
    assert len(rings) == 2 * (values[0] == values[0]) + (values[1] == values[1])
    assert "Xavier" in chart.words


def test_a_png_has_the_dots_too() -> None:
    """A path without length is drawn by Agg only if it is not moved onto the pixels."""
    canvas, (axes,) = figures.panels(1)
    charts.dots(axes, np.array([[0.3, 0.5], [0.7, 0.5]]), 10, charts.ISI)
    pixels = imread(BytesIO(rendered(canvas, "png")))[..., :3]
    assert (np.abs(pixels - to_rgb(charts.ISI)).max(-1) < 0.02).sum() > 100


@pytest.mark.parametrize("name", ["cup $5 to $6", r"$\alpha$", r"a \$ b", "$x_1$ & <b>"])
def test_names_with_dollar_signs_are_shown_as_they_are(name: str) -> None:
    with mpl.rc_context(figures.STYLE):
        canvas, (panel,) = figures.panels(1, columns=1)
        panel.set(title=name, xlabel=name)
        panel.set_yticks([0, 1], [name, "plain"])
        panel.plot([0, 1], label=name)
        figures.legend(canvas, [panel])
    drawn = ElementTree.fromstring(rendered(canvas, "svg"))  # noqa: S314
    texts = [element.text for element in drawn.iter("{http://www.w3.org/2000/svg}text")]
    assert texts.count(name) == 4
