"""The page as readers see it: opened from a file in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from isi.report import page
from isi.report.section import Content, ReportSection
from tests.browser import Opened, opened
from tests.reports import small_results

if TYPE_CHECKING:
    from playwright.sync_api import Browser

#: A table whose order by number is not that of its text, with what is not there and thousands among it.
FRAME = pd.DataFrame({"name": ["b", "a", "c", "d"], "points": [9.0, 1234.0, None, -20.0]})
TEXT = "# Plain\n\n@table plain_table | Plain table\nOf four rows."
PLAIN = ReportSection("plain", lambda _: [Content(tables={"plain_table": FRAME})], TEXT)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole report of a few invented runs, and a part with a plain table."""
    folder = tmp_path_factory.mktemp("report")
    page.write(folder, small_results(["home", "away", "moved"]), (*page.SECTIONS, PLAIN))
    return folder / "index.html"


@contextmanager
def fine(browser: Browser, path: Path, **how: object) -> Iterator[Opened]:
    """An opened page, which in the end has had no error, asked for nothing and is no wider than its window."""
    with opened(browser, path, **how) as found:  # type: ignore[arg-type]
        yield found
        assert found.errors == []
        assert found.requests == []
        assert found.overflow == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 768, 1280])
def test_all_of_it_fits_its_window_and_asks_for_nothing(
    chromium: Browser, report: Path, width: int, scheme: str
) -> None:
    with fine(chromium, report, width=width, scheme=scheme) as found:
        assert found.page.title()
        found.page.get_by_role("button", name="Open all parts").click()
        assert found.page.locator("main details:not([open]):not(.words)").count() == 0
        assert found.overflow == 0
        found.page.get_by_role("button", name="Close all parts").click()
        assert found.page.locator("main details[open]").count() == 0


def test_the_answer_and_its_figure_are_in_the_first_screen(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as found:
        for what in (".answer", "#verdict .plot svg"):
            box = found.page.locator(what).bounding_box()
            assert box
            assert box["y"] + box["height"] <= 900


def test_a_click_in_the_contents_opens_a_part_and_goes_there(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as found:
        part = found.page.locator("#forgetting > details")
        assert part.get_attribute("open") is None
        found.page.locator("nav a[href='#forgetting']").click()
        found.page.locator("#forgetting > details[open]").wait_for()  # browsers tell of a new address a moment later
        assert found.page.locator("#figure-forgetting").is_visible()
        part.locator("> summary").click()
        found.page.locator("nav a[href='#forgetting']").click()  # again, though the address is the same
        assert part.get_attribute("open") is not None


def test_a_link_to_a_folded_table_opens_all_around_it(chromium: Browser, report: Path) -> None:
    with fine(chromium, report, fragment="table-differences_away") as found:
        assert found.page.locator("#table-differences_away table").is_visible()


def test_contents_stand_beside_the_page_and_fold_on_a_phone(chromium: Browser, report: Path) -> None:
    for width, shown in ((1280, True), (390, False)):
        with fine(chromium, report, width=width) as found:
            assert found.page.locator("nav ul").first.is_visible() is shown


def test_tables_sort_by_click_and_by_keyboard_and_come_back(chromium: Browser, report: Path) -> None:
    with fine(chromium, report, fragment="plain") as found:
        table = found.page.locator("#table-plain_table table")

        def names() -> str:
            return "".join(table.locator("tbody th").all_text_contents())

        by_points, by_name = (table.locator("thead th", has_text=name) for name in ("points", "name"))
        assert by_points.get_attribute("aria-sort") == "none"
        by_points.get_by_role("button").click()
        assert (names(), by_points.get_attribute("aria-sort")) == ("abdc", "descending")  # what is not there is last
        by_points.get_by_role("button").click()
        assert (names(), by_points.get_attribute("aria-sort")) == ("dbac", "ascending")
        by_name.get_by_role("button").focus()
        found.page.keyboard.press("Enter")
        assert (names(), by_name.get_attribute("aria-sort")) == ("abcd", "ascending")
        assert by_points.get_attribute("aria-sort") == "none"
        for _ in range(2):
            found.page.keyboard.press("Space")
        assert (names(), by_name.get_attribute("aria-sort")) == ("bacd", "none")


def test_words_are_explained_at_the_mouse_and_by_keyboard(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as found:
        word, tip = found.page.locator(".answer a.term", has_text="MRR*").first, found.page.locator("#tip")
        assert not tip.is_visible()
        word.hover()
        tip.wait_for()
        assert "ranked answers" in tip.inner_text()
        found.page.mouse.move(0, 0)
        tip.wait_for(state="hidden")
        word.focus()
        assert tip.is_visible()
        assert word.get_attribute("aria-describedby") == "tip"
        found.page.keyboard.press("Escape")
        assert not tip.is_visible()


def test_every_word_that_is_marked_is_explained_and_tips_stay_within_a_phone(chromium: Browser, report: Path) -> None:
    with fine(chromium, report, width=390) as found:
        found.page.get_by_role("button", name="Open all parts").click()
        unexplained = "links => links.filter(one => !document.querySelector(one.hash + ' + dd')).map(one => one.hash)"
        assert found.page.locator("a.term").evaluate_all(unexplained) == []
        found.page.mouse.move(0, 0)
        for link in found.page.locator(".answer a.term").all():
            link.focus()
            assert found.overflow == 0
            box = found.page.locator("#tip").bounding_box()
            assert box
            assert 0 <= box["x"] <= box["x"] + box["width"] <= 390


def test_figures_are_dark_where_it_is_dark(chromium: Browser, report: Path) -> None:
    looks = {}
    for scheme in ("light", "dark"):
        with fine(chromium, report, scheme=scheme) as found:
            looks[scheme] = found.page.locator("#verdict svg text").first.evaluate("one => getComputedStyle(one).fill")
            paper = found.page.evaluate("getComputedStyle(document.body).backgroundColor")
            behind = found.page.locator("#verdict .plot").evaluate("one => getComputedStyle(one).backgroundColor")
            assert behind in ("rgba(0, 0, 0, 0)", paper)
            white = "all => all.filter(one => getComputedStyle(one).fill === 'rgb(255, 255, 255)').length"
            assert found.page.locator(".plot svg path").evaluate_all(white) == 0 or scheme == "light"
    assert looks == {"light": "rgb(27, 30, 35)", "dark": "rgb(230, 232, 235)"}


def test_print_opens_what_is_folded_and_closes_it_again(chromium: Browser, report: Path) -> None:
    with opened(chromium, report) as found:
        closed = found.page.locator("main details:not([open])").count()
        assert closed
        found.page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert found.page.locator("main details:not([open])").count() == 0
        found.page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert found.page.locator("main details:not([open])").count() == closed
        assert found.errors == []


def test_without_a_script_paper_shows_all_and_no_table_is_cut_off(chromium: Browser, report: Path) -> None:
    with opened(chromium, report, width=718, script=False) as found:  # of a sheet, without its margins
        found.page.emulate_media(media="print")
        folded = found.page.locator("#table-differences table")
        assert folded.bounding_box()
        assert found.page.locator("main").bounding_box()["height"] > 3000  # type: ignore[index]
        wide = """all => all.filter(one => one.getBoundingClientRect().right > 719)
            .map(one => [one.closest('details').id, one.getBoundingClientRect().right])"""
        assert found.page.locator("main table").evaluate_all(wide) == []


def test_tables_say_what_they_are_to_who_does_not_see_them(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as found:
        bare = "all => all.filter(one => !one.caption?.textContent.trim() || !one.querySelector('th[scope]')).length"
        assert found.page.locator("main table").evaluate_all(bare) == 0
        silent = """all => all.filter(one => {
            const words = document.getElementById(one.getAttribute('aria-describedby'));
            return !one.getAttribute('aria-label') || !/\\d/.test(words.textContent);
        }).map(one => one.getAttribute('aria-label'))"""
        assert found.page.locator(".plot").evaluate_all(silent) == []


def test_what_the_page_links_to_is_there(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as found:
        away = found.page.locator("a:not([href^='#'])").evaluate_all("all => all.map(one => one.getAttribute('href'))")
    files = {link for link in away if not link.startswith("https://")}
    assert {"tables/immediate.csv", "figures/verdict.svg", "figures/verdict.png", "metrics.json"} <= files
    assert [link for link in files if not (report.parent / link).exists()] == []
