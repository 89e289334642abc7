"""The page of the report, opened from a file in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from isi.report.page import PAGES, Page
from isi.report.section import Content, ReportSection
from tests.browser import Opened, opened
from tests.reports import small_results, svg_alone
from tests.variants import beyond_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

#: A table whose numeric order differs from the order of its texts, with a null and a number above
#: 1,000.
FRAME = pd.DataFrame({"name": ["b", "a", "c", "d"], "points": [9.0, 1234.0, None, -20.0]})
#: Two rows have the name of the row before, which is not written again.
SAME = pd.DataFrame({"name": ["a", "a", "b", "b"], "points": [1.0, 4.0, 3.0, 2.0]})
TEXT = """# Plain

@table plain_table | Plain table
Of four rows.

@table same_names | Names that repeat
Of two names."""
PLAIN = ReportSection(
    "plain", lambda _: [Content(tables={"plain_table": FRAME, "same_names": SAME})], TEXT
)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole report of small results, and a section with a plain table."""
    folder = tmp_path_factory.mktemp("report")
    with svg_alone():
        whole = Page.of("report")
        results = small_results(["home", "away", "moved"])
        replace(whole, sections=[*whole.sections, PLAIN]).write(folder, results)
        Page.of("beyond").write(folder / "beyond", beyond_of(results))
    return folder / "index.html"


@contextmanager
def fine(browser: Browser, path: Path, **settings: object) -> Iterator[Opened]:
    """An opened page; checks in the end that it has no error, no request and no overflow."""
    with opened(browser, path, **settings) as window:  # type: ignore[arg-type]
        yield window
        assert window.errors == []
        assert window.requests == []
        assert window.overflow == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 768, 1280])
def test_all_of_it_fits_its_window_and_asks_for_nothing(
    chromium: Browser, report: Path, width: int, scheme: str
) -> None:
    with fine(chromium, report, width=width, scheme=scheme) as window:
        assert window.page.title()
        if width != 768:  # the contents are beside the page on a desktop, and folded on a phone
            assert window.page.locator("nav ul").first.is_visible() is (width == 1280)
        window.page.get_by_role("button", name="Open all parts").click()
        assert window.page.locator("main details:not([open]):not(.words)").count() == 0
        assert window.overflow == 0
        window.page.get_by_role("button", name="Close all parts").click()
        assert window.page.locator("main details[open]").count() == 0


def test_the_picture_and_the_answer_are_in_the_first_screen(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report) as window:
        boxes = [window.page.locator(one).bounding_box() for one in (".picture", ".answer")]
        assert boxes[0]
        assert boxes[1]
        assert boxes[0]["y"] + boxes[0]["height"] <= boxes[1]["y"] < 800


@pytest.mark.parametrize("width", [390, 768, 1280, 1920])
def test_texts_of_drawings_are_at_least_12_pixels_and_lie_within(
    chromium: Browser, report: Path, width: int
) -> None:
    small = """all => all.filter(one => one.getClientRects().length).map(one => [one.textContent,
      parseFloat(getComputedStyle(one).fontSize) * one.getScreenCTM().a])
      .filter(([, size]) => size < 11.95)"""
    outside = """all => all.filter(one => {
      const box = one.getBoundingClientRect(), place = one.ownerSVGElement.parentElement;
      const around = place.getBoundingClientRect();
      return box.width && (box.left < around.left - 1 || box.right > around.right + 1);
    }).map(one => one.textContent)"""
    with fine(chromium, report, width=width) as window:
        window.page.get_by_role("button", name="Open all parts").click()
        texts = window.page.locator(".picture text, .chart text")
        assert texts.count() > 20
        assert texts.evaluate_all(small) == []
        assert texts.evaluate_all(outside) == []


def test_contents_and_links_open_the_folded_parts_they_lead_to(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report) as window:
        part = window.page.locator("#forgetting > details")
        assert part.get_attribute("open") is None
        window.page.locator("nav a[href='#forgetting']").click()
        # browsers tell of a new address a moment later
        window.page.locator("#forgetting > details[open]").wait_for()
        assert window.page.locator("#figure-forgetting").is_visible()
        part.locator("> summary").click()
        # again, though the address is the same
        window.page.locator("nav a[href='#forgetting']").click()
        assert part.get_attribute("open") is not None
    with fine(chromium, report, fragment="table-differences_isi") as window:
        assert window.page.locator("#table-differences_isi table").is_visible()


@pytest.mark.parametrize("fragment", ["%E0%A4%A", "explorer/+%E0%A4%A/ers/xavier//", "no/such"])
def test_a_broken_address_shows_the_page(chromium: Browser, report: Path, fragment: str) -> None:
    with fine(chromium, report, fragment=fragment) as window:
        assert window.page.locator("#page").is_visible()
        window.page.evaluate("location.hash = 'forgetting'")
        window.page.locator("#forgetting > details[open]").wait_for()


def test_tables_sort_by_click_and_by_keyboard_and_come_back(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report, fragment="plain") as window:
        table = window.page.locator("#table-plain_table table")

        def names() -> str:
            return "".join(table.locator("tbody th").all_text_contents())

        by_points, by_name = (
            table.locator("thead th", has_text=name) for name in ("points", "name")
        )
        assert by_points.get_attribute("aria-sort") == "none"
        by_points.get_by_role("button").click()
        # null is last
        assert (names(), by_points.get_attribute("aria-sort")) == ("abdc", "descending")
        by_points.get_by_role("button").click()
        assert (names(), by_points.get_attribute("aria-sort")) == ("dbac", "ascending")
        by_name.get_by_role("button").focus()
        window.page.keyboard.press("Enter")
        assert (names(), by_name.get_attribute("aria-sort")) == ("abcd", "ascending")
        assert by_points.get_attribute("aria-sort") == "none"
        for _ in range(2):
            window.page.keyboard.press("Space")
        assert (names(), by_name.get_attribute("aria-sort")) == ("bacd", "none")


def test_words_are_explained_at_the_mouse_and_by_keyboard(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as window:
        word, tip = (
            window.page.locator(".answer a.term", has_text="MRR*").first,
            window.page.locator("#tip"),
        )
        assert not tip.is_visible()
        word.hover()
        tip.wait_for()
        assert "rank of an answer" in tip.inner_text()
        window.page.mouse.move(0, 0)
        tip.wait_for(state="hidden")
        word.focus()
        assert tip.is_visible()
        assert word.get_attribute("aria-describedby") == "tip"
        window.page.keyboard.press("Escape")
        assert not tip.is_visible()


def test_every_word_that_is_marked_is_explained_and_tips_stay_within_a_phone(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report, width=390) as window:
        window.page.get_by_role("button", name="Open all parts").click()
        unexplained = (
            "links => links.filter(one => !document.querySelector(one.hash + "
            "' + dd')).map(one => one.hash)"
        )
        assert window.page.locator("a.term").evaluate_all(unexplained) == []
        window.page.mouse.move(0, 0)
        for link in window.page.locator(".answer a.term").all():
            link.focus()
            assert window.overflow == 0
            box = window.page.locator("#tip").bounding_box()
            assert box
            assert 0 <= box["x"] <= box["x"] + box["width"] <= 390


def test_figures_are_dark_where_it_is_dark(chromium: Browser, report: Path) -> None:
    """Their colours are those of the page; on other pages a filter turns them."""
    inks, filters = {}, {}
    for scheme in ("light", "dark"):
        with fine(chromium, report, scheme=scheme) as window:
            of_page = window.page.evaluate("getComputedStyle(document.body).color")
            inks[scheme] = of_page
            fills = "all => [...new Set(all.map(one => getComputedStyle(one).fill))]"
            assert of_page in window.page.locator(".chart text").evaluate_all(fills)
            drawings = window.page.locator(".chart svg")
            filters[scheme] = set(
                drawings.evaluate_all("all => all.map(one => getComputedStyle(one).filter)")
            )
    assert inks["light"] != inks["dark"]
    assert filters == {"light": {"none"}, "dark": {"none"}}


def test_print_opens_what_is_folded_and_closes_it_again(chromium: Browser, report: Path) -> None:
    with opened(chromium, report) as window:
        closed = window.page.locator("main details:not([open])").count()
        assert closed
        window.page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert window.page.locator("main details:not([open])").count() == 0
        window.page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert window.page.locator("main details:not([open])").count() == closed
        assert window.errors == []


def test_without_a_script_paper_shows_all_and_no_table_is_cut_off(
    chromium: Browser, report: Path
) -> None:
    # of a sheet, without its margins
    with opened(chromium, report, width=718, script=False) as window:
        window.page.emulate_media(media="print")
        folded = window.page.locator("#table-differences_isi table")
        assert folded.bounding_box()
        assert window.page.locator("main").bounding_box()["height"] > 3000  # type: ignore[index]
        wide = """all => all.filter(one => one.getBoundingClientRect().right > 719)
            .map(one => [one.closest('details').id, one.getBoundingClientRect().right])"""
        assert window.page.locator("main table").evaluate_all(wide) == []


def test_tables_say_what_they_are_to_who_does_not_see_them(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as window:
        bare = (
            "all => all.filter(one => !one.caption?.textContent.trim() || "
            "!one.querySelector('th[scope]')).length"
        )
        assert window.page.locator("main table").evaluate_all(bare) == 0
        silent = """all => all.filter(one => {
            const words = document.getElementById(one.getAttribute('aria-describedby'));
            return !one.getAttribute('aria-label') || !/\\d/.test(words.textContent);
        }).map(one => one.getAttribute('aria-label'))"""
        assert window.page.locator(".plot").evaluate_all(silent) == []


def test_what_the_page_links_to_is_there(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as window:
        away = window.page.locator("a:not([href^='#'])").evaluate_all(
            "all => all.map(one => one.getAttribute('href'))"
        )
    files = {link for link in away if not link.startswith("https://")}
    assert {
        "tables/immediate.csv",
        "figures/answer.svg",
        "figures/answer.png",
        "metrics.json",
    } <= files
    assert [link for link in files if not (report.parent / link.split("#")[0]).exists()] == []
    beyond = (report.parent / "beyond/index.html").read_text("utf-8")
    assert all(
        f'id="{link.split("#")[1]}"' in beyond for link in files if link.startswith("beyond/")
    )


def test_the_entry_of_the_contents_that_was_clicked_is_marked(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report) as window:
        links = window.page.locator("nav li a")
        assert links.count() > 15
        window.page.get_by_role("button", name="Open all parts").click()
        for link in links.all():
            link.click()
            window.page.evaluate(
                "new Promise(done => requestAnimationFrame(() => setTimeout(done, 20)))"
            )
            marked = window.page.locator("nav a[aria-current]").evaluate_all(
                "all => all.map(one => one.hash)"
            )
            assert marked == [link.get_attribute("href")]


def test_the_strip_of_the_papers_figures_leads_to_what_it_names(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report) as window:
        links = window.page.locator(".places a")
        titles = links.all_text_contents()
        assert {
            "Figure 1",
            "2a",
            "2b",
            "3a",
            "3b",
            "Table 1",
            "Table 2",
            "Table 3",
            "all results",
        } <= {*titles}
        for link, title in zip(links.all(), titles, strict=True):
            place = link.get_attribute("href")
            assert place == f"#{PAGES['paper'][title]}"
            window.page.get_by_role("button", name="Close all parts").click()
            link.click()
            target = window.page.locator(place)
            target.wait_for()
            assert target.locator("table, svg").first.is_visible()
            shown = target.locator("figcaption, summary").first.inner_text()
            if title.startswith("Table") or title in ("Figure 1", "2a", "2b", "3a", "3b"):
                assert title.removeprefix("Figure ") in shown.split(".")[0]


def test_a_sorted_table_shows_the_names_that_were_not_written_again(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report, fragment="plain") as window:
        table = window.page.locator("#table-same_names table")
        names = table.locator("tbody th")
        hidden = "all => all.filter(one => one.querySelector('.hidden')).length"
        assert names.evaluate_all(hidden) == 2
        table.locator("thead th", has_text="points").get_by_role("button").click()
        assert names.all_text_contents() == ["a", "b", "b", "a"]
        assert names.evaluate_all(hidden) == 0


def test_one_layout_of_a_figure_is_shown_and_lines_have_their_values(
    chromium: Browser, report: Path
) -> None:
    for width, kind in ((1280, "wide"), (390, "narrow")):
        place = "figure-figure3a_immediate"
        with fine(chromium, report, width=width, fragment=place) as window:
            drawings = window.page.locator(f"#{place} svg")
            shown = drawings.evaluate_all(
                "all => all.filter(one => one.checkVisibility()).map(one => one.classList[0])"
            )
            assert shown == [kind]
            titles = window.page.locator(f"#{place} svg.{kind} title").all_text_contents()
            assert any(title.startswith("ERS – 1: ") for title in titles)
            box = window.page.locator(f"#{place} svg.{kind}").bounding_box()
            around = window.page.locator(f"#{place} .plot").bounding_box()
            assert box
            assert around
            assert box["width"] >= around["width"] - 2  # the whole width


def test_no_two_elements_have_the_same_id(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as window:
        ids = window.page.locator("[id]").evaluate_all("all => all.map(one => one.id)")
        assert len({*ids}) == len(ids) > 100


def test_no_table_scrolls_sideways_on_a_desktop(chromium: Browser, report: Path) -> None:
    with fine(chromium, report) as window:
        window.page.get_by_role("button", name="Open all parts").click()
        wide = """all => all.filter(one => one.scrollWidth > one.clientWidth + 1)
            .map(one => [one.getAttribute("aria-label"), one.scrollWidth - one.clientWidth])"""
        assert window.page.locator(".scroll").evaluate_all(wide) == []


def test_a_table_on_a_phone_scrolls_in_its_box_with_its_first_column_in_sight(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report, width=390) as window:
        window.page.get_by_role("button", name="Open all parts").click()
        left = """all => all.filter(one => one.scrollWidth > one.clientWidth + 1).map(one => {
            one.scrollLeft = one.scrollWidth;
            const first = one.querySelector("tbody th").getBoundingClientRect();
            return [first.left - one.getBoundingClientRect().left, first.width / one.clientWidth];
        })"""
        moved = window.page.locator(".scroll:has(.sortable)").evaluate_all(left)
        assert moved
        assert all(abs(place) < 2 and width < 0.6 for place, width in moved)
        assert window.overflow == 0


def test_on_paper_no_list_of_files_is_left_and_names_that_repeat_are_written(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, width=718) as window:
        window.page.evaluate("dispatchEvent(new Event('beforeprint'))")
        window.page.emulate_media(media="print")
        assert window.page.locator(".files-only").count()
        visible = "all => all.filter(one => one.getBoundingClientRect().height > 1).length"
        assert window.page.locator(".files-only, .files").evaluate_all(visible) == 0
        names = window.page.locator("#table-same_names tbody th .same")
        assert names.evaluate_all(visible) == names.count() == 2
        broken = """all => all.filter(one => one.getClientRects().length > 1).length"""
        assert window.page.locator("td i").evaluate_all(broken) == 0


def test_a_link_to_a_figure_opens_the_figure_and_not_its_data(
    chromium: Browser, report: Path
) -> None:
    with fine(chromium, report, fragment="figure-figure3a_immediate") as window:
        figure = window.page.locator("#figure-figure3a_immediate")
        assert figure.locator("svg").first.is_visible()
        assert figure.locator("details.words").get_attribute("open") is None
