"""Figures as elements of the page."""

import re

import matplotlib as mpl
import numpy as np

from isi.report import figures
from tests.reports import runs


def drawn(title: str = "a < b") -> mpl.figure.Figure:
    """Two panels of three lines each, with a legend below."""
    rows = runs(
        [
            (model, scope, 1, seed, epoch, 0.3 + epoch / 10 + seed / 20)
            for model in ("xavier", "es", "joint")
            for scope in ("all", "novel")
            for epoch in (0, 1)
            for seed in (0, 1)
        ]
    )
    with mpl.rc_context(figures.STYLE):
        canvas = figures.by_epoch(rows, ["xavier", "es"], ("all", "novel"))
        canvas.axes[0].set_title(title)
    return canvas


def inline(name: str) -> str:
    return figures.inline(figures.rendered(drawn(), "svg").decode(), name)


def test_figures_share_no_ids_and_what_they_refer_to_is_there() -> None:
    one, other = inline("f0"), inline("f1")
    ids = [re.findall(r' id="([^"]+)"', text) for text in (one, other)]
    assert len(set(ids[0])) == len(ids[0])
    assert not set(ids[0]) & set(ids[1])
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', one)) <= set(ids[0])


def test_a_figure_has_no_style_of_its_own_for_the_page_and_its_text_is_text() -> None:
    text = inline("f0")
    assert "font" not in re.sub(r"font-size|font-weight", "", text)
    assert not re.search(r'<[^>]* style="(?!min-width)', text)  # but for its least width
    rules = re.findall(r"([^{}]+)\{[^}]*\}", re.search(r"<style>(.*?)</style>", text)[1])  # type: ignore[index]
    assert set(rules) == {f".{name}" for name in re.findall(r'class="([^"]+)"', text)}
    assert all(rule.startswith(".f0-") for rule in rules)  # no other figure has them
    assert ">a &lt; b</text>" in text


def test_a_figure_is_described_in_its_own_numbers() -> None:
    lines = "across: epoch of fine-tuning; up: MRR* (points). " + ", ".join(
        f"{name} from 32.5 to 42.5" for name in ("Xavier", "ES")
    )
    lines += ", Joint 37.5"
    assert figures.in_words(drawn()) == f"A < b; {lines}. (b) novel entities; {lines}."


def test_coordinates_are_rounded_and_texts_are_not() -> None:
    text = '<path d="M 1.23456 -2.00001" /><text x="3.14159">0.12345</text>'
    assert figures.rounded(text) == '<path d="M 1.23 -2.00" /><text x="3.14">0.12345</text>'


def test_noise_of_another_processor_changes_no_figure() -> None:
    drawings = []
    for noise in (0, 1e-9):
        canvas, (axes,) = figures.panels(1, 1)
        axes.plot([1, 2, 3], np.array([40.123, 45.678, 60.111]) * (1 + noise))
        axes.fill_between([1, 2, 3], np.array([39.21, 44.12, 58.33]) * (1 + noise), [41, 46, 62])
        drawings.append(figures.rendered(canvas, "svg"))
    assert drawings[0] == drawings[1]


def test_groups_without_attributes_are_left_out_and_others_stay() -> None:
    nested = '<svg><g><g class="a"><g><path/></g></g></g></svg>'
    assert figures.without_bare_groups('<g><g id="x"><g><path /></g></g></g>') == (
        '<g id="x"><path /></g>'
    )
    assert figures.without_bare_groups("<g></g>") == ""
    assert '<g class="a"><path/></g>' in figures.without_bare_groups(nested)
