"""The explorer in a real browser shows the contents of the tables of single insertions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from isi.analyses import single_insertions
from isi.analyses.single_insertions import SHOWN, TABLES
from isi.report import page
from isi.report.words import label
from tests.browser import Opened, opened
from tests.reports import of_experiment, small_results
from tests.small_grid import EXPLORER, explorer_task

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

#: Names of the 14 entities of the small graph; some contain characters of HTML markup.
NAMES = ["bowl", "bottle", "<b>box</b>", "kitchen", "table top", "tap", "50% / half", "cup", "cupboard", "mug", "pan",
         "pot", "sofa", "shelf"]  # fmt: skip
BEST = "soft_hybrid"
MARKS = {"told": "insert triple", "learned": "trained", "held_out": "held out"}

#: The tables of single insertions, by name, as the pipeline writes them and the report reads them.
Shown = dict[str, pd.DataFrame]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    folder, tables = tmp_path_factory.mktemp("explorer"), {}
    done = single_insertions.single_insertions(*explorer_task())
    for name, (table, order) in TABLES.items():
        table.write_file(folder / name, done[name].sort_values(order, kind="stable"), "single_insertions")
        tables[name] = replace(table, template=f"{folder}/{name}").read_text()
    return tables


@pytest.fixture(scope="module")
def report(shown: Shown, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page whose explorer shows insertions into a small graph."""
    results = small_results(["home"], explorer={"experiments": [], **EXPLORER.model_dump()})
    entities = pd.DataFrame({"entity": NAMES, "kind": "object"})
    folder = tmp_path_factory.mktemp("report")
    section = next(section for section in page.SECTIONS if section.name == "explorer")
    page.write(folder, of_experiment(results, "home", entities=entities, analyses={"explorer": shown}), [section])
    return folder / "index.html"


def combobox(found: Opened) -> Locator:
    return found.page.get_by_role("combobox")


def options(found: Opened) -> list[str]:
    return found.page.locator("[role=option]").all_inner_texts()


def heading(found: Opened) -> str:
    return found.page.locator("#explorer-name").inner_text()


def query_of(shown: Shown, entity: int, model: str, epoch: int, relation: str, hidden: str) -> pd.DataFrame:
    rows = shown["answers"].set_index(["entity", "model", "epoch", "relation", "hidden"]).sort_index()
    return rows.loc[[(entity, model, epoch, relation, hidden)]].sort_values("rank")


def expected(rows: pd.DataFrame) -> list[str]:
    """The expected lines of a list of answers."""
    first = rows[rows["rank"] <= EXPLORER.answers]
    return [f"✓ {NAMES[answer]} {MARKS[true]}" if isinstance(true, str) else NAMES[answer]
            for answer, true in zip(first["answer"], first["true"], strict=True)]  # fmt: skip


def further(rows: pd.DataFrame) -> list[str]:
    true = rows[(rows["rank"] > EXPLORER.answers) & rows["true"].notna()]
    return [f"{rank} {NAMES[answer]} ({MARKS[mark]})"
            for rank, answer, mark in zip(true["rank"], true["answer"], true["true"], strict=True)]  # fmt: skip


def test_letters_and_arrows_choose_an_entity(chromium: Browser, report: Path, shown: Shown) -> None:
    ids = sorted(shown["entities"]["entity"], key=lambda entity: NAMES[entity].lower())
    wanted = [NAMES[entity] for entity in ids if "o" in NAMES[entity]]
    with opened(chromium, report, fragment="explorer") as found:
        field = combobox(found)
        field.fill("o")
        assert field.get_attribute("aria-expanded") == "true"
        assert sorted(text.removesuffix(" object") for text in options(found)) == sorted(wanted)
        field.press("ArrowDown")
        field.press("ArrowDown")
        active = found.page.locator("[role=option][aria-selected=true]")
        assert active.get_attribute("id") == field.get_attribute("aria-activedescendant")
        name = active.inner_text().removesuffix(" object")
        assert name == options(found)[1].removesuffix(" object")
        field.press("Enter")
        assert field.get_attribute("aria-expanded") == "false"
        assert field.input_value() == name
        assert heading(found) == f"{name} (object)"
        field.fill("nothing of the sort")
        assert options(found) == []
        field.press("Enter")
        field.press("Escape")
        assert (field.input_value(), heading(found)) == (name, f"{name} (object)")
        field.click()
        field.press("Enter")  # nothing was typed, and nothing chosen
        assert heading(found) == f"{name} (object)"
        field.press("ArrowUp")  # from a closed list: its last
        field.press("Enter")
        assert heading(found) == f"{NAMES[ids[-1]]} (object)"
        assert found.errors == []


@pytest.mark.parametrize("model", ["xavier", "rs", BEST])
def test_what_is_shown_of_an_entity_is_what_the_tables_hold(
    chromium: Browser, report: Path, shown: Shown, model: str
) -> None:
    for entity, seed in shown["entities"][["entity", "seed"]].head(2).itertuples(index=False):
        with opened(chromium, report, fragment="explorer") as found:
            combobox(found).fill(NAMES[entity])
            combobox(found).press("Enter")
            found.page.get_by_role("radio", name=label(model), exact=True).check()
            assert heading(found) == f"{NAMES[entity]} (object)"
            assert found.page.locator("#explorer-told").inner_text().startswith(f"Inserted by seed {seed}.")
            for folded in found.page.locator("#explorer-answers summary").all():
                folded.click()
            steps = [(model, 0), (model, EXPLORER.epochs), ("joint", 0)]
            asked = shown["answers"][shown["answers"]["entity"] == entity]
            queries = list(asked.groupby(["relation", "hidden"]).groups)
            drawn = found.page.locator(".ex-query")
            assert drawn.count() == len(queries)
            titles = [title.removesuffix(" (nothing is true)") for title in drawn.locator("h6").all_inner_texts()]
            for relation, hidden in queries:
                ends = (NAMES[entity], "?") if hidden == "tail" else ("?", NAMES[entity])
                own = drawn.nth(titles.index(f"{ends[0]} {relation} {ends[1]}")).locator(".ex-columns > div")
                for place, (name, epoch) in enumerate(steps):
                    rows = query_of(shown, entity, name, epoch, relation, hidden)
                    assert own.nth(place).locator("li").all_inner_texts() == expected(rows)
                    told = own.nth(place).locator("p").all_inner_texts()[1:]
                    assert told == ([f"Further true ones: {', '.join(further(rows))}"] if further(rows) else [])
            assert found.errors == []


def test_indicators_are_the_tables_with_their_similarity(chromium: Browser, report: Path, shown: Shown) -> None:
    entity = int(shown["entities"]["entity"].iloc[0])
    rows = shown["indicators"][shown["indicators"]["entity"] == entity]
    with opened(chromium, report, fragment=f"explorer/{NAMES[entity]}/es") as found:
        columns = found.page.locator("#explorer-indicators > div")
        by_label = dict(zip(columns.locator("caption").all_inner_texts(), range(columns.count()), strict=True))
        assert by_label.keys() == {label(model) for model in ("es", "rs", "ers", BEST)}
        for model in ("es", "rs", "ers", BEST):
            own = rows[rows["model"] == model]
            lines = columns.nth(by_label[label(model)]).locator("tbody tr")
            assert lines.count() == len(own)
            for line, row in zip(lines.all(), own.itertuples(), strict=True):
                cells = line.locator("th, td").all_inner_texts()
                assert cells[0] == NAMES[row.indicator]
                assert [float(cell.replace("−", "-")) for cell in cells[-2:]] == pytest.approx(
                    [row.by_words, row.by_relations], abs=0.0051
                )
                if model == BEST:
                    assert float(cells[1].removesuffix(" %")) == pytest.approx(100 * row.weight, abs=0.51)


def test_the_map_has_a_mark_for_each_known_entity_and_for_what_each_model_does(
    chromium: Browser, report: Path, shown: Shown
) -> None:
    entity, seed = shown["entities"][["entity", "seed"]].iloc[0]
    known = shown["places"][(shown["places"]["seed"] == seed) & (shown["places"]["model"] == "theta0")]
    with opened(chromium, report, fragment=f"explorer/{NAMES[entity]}/es") as found:
        marks = found.page.locator("#explorer-map .ex-known title").all_text_contents()
        assert sorted(marks) == sorted(NAMES[one] for one in known["entity"])
        assert found.page.locator("#explorer-map g").count() == len(SHOWN) + 1
        indicators = found.page.locator("#explorer-map .ex-indicator title").all_text_contents()
        of_es = shown["indicators"][(shown["indicators"]["entity"] == entity) & (shown["indicators"]["model"] == "es")]
        assert indicators == [NAMES[one] for one in of_es["indicator"]]
        assert NAMES[entity] in (found.page.locator("#explorer-map").get_attribute("aria-label") or "")
        first, second = known.iloc[:2][["x", "y"]].to_numpy()
        ends = [[float(mark.get_attribute(axis) or "nan") for axis in ("cx", "cy")]
                for mark in found.page.locator("#explorer-map .ex-known").all()[:2]]  # fmt: skip
        across, up = (first - second) * [1, -1]
        assert (ends[0][0] - ends[1][0]) * up == pytest.approx((ends[0][1] - ends[1][1]) * across, abs=1)


def test_an_address_opens_an_entity_and_choices_stand_in_it(chromium: Browser, report: Path, shown: Shown) -> None:
    entities = shown["entities"]["entity"].tolist()[:3]
    with opened(chromium, report, fragment="explorer") as found:
        for entity in entities:
            combobox(found).fill(NAMES[entity])
            combobox(found).press("Enter")
            found.page.get_by_role("radio", name="ERS").check()
            address = found.page.evaluate("location.hash").removeprefix("#")
            assert found.page.get_by_role("radio", name="ERS").is_checked()
            with opened(chromium, report, fragment=address) as again:
                assert heading(again) == f"{NAMES[entity]} (object)"
                assert again.page.get_by_role("radio", name="ERS").is_checked()
                assert again.errors == []
        started = heading(found)
        found.page.evaluate("location.hash = '#explorer/no such/thing'")
        found.page.evaluate("location.hash = '#else'")
        assert heading(found) == started
        assert found.errors == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_sticks_out_and_nothing_is_asked_for(chromium: Browser, report: Path, width: int, scheme: str) -> None:
    with opened(chromium, report, width=width, scheme=scheme, fragment="explorer") as found:
        combobox(found).click()
        assert found.overflow == 0
        assert found.page.locator("#explorer-box").is_visible()
        assert found.errors == found.requests == []


def test_paper_and_readers_without_scripts_have_a_sentence(chromium: Browser, report: Path) -> None:
    with opened(chromium, report, fragment="explorer") as found:
        found.page.emulate_media(media="print")
        assert found.page.locator(".ex-paper").is_visible()
        assert not found.page.locator("#explorer-box").is_visible()
    with opened(chromium, report, script=False) as found:
        found.page.get_by_text("An explorer of insertions").last.click()
        assert found.page.locator(".ex-paper").is_visible()
        assert not found.page.locator("#explorer-box").is_visible()
