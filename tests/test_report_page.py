"""The pages of the report, drawn from the committed tables."""

import json
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
import pytest
from matplotlib.figure import Figure

from isi.errors import InputError
from stages.report import charts, figures, page
from stages.report.page import BAR, pages
from tests import committed

ROOT = Path(__file__).parent.parent
#: For each page, a table of it, and a column that this code gives it.
OF_THIS_CODE = {"report": ("gains", "graph"), "beyond": ("strong_ai2thor", "held_out")}


def is_run(name: str) -> bool:
    """Whether git has the tables of a run of this code; else it gets them with the next one."""
    table, column = OF_THIS_CODE[name]
    path = ROOT / "reports" / pages()[name].folder / "tables" / f"{table}.csv"
    return path.exists() and column in pd.read_csv(path, nrows=0)


#: Pages whose tables this code made.
RUN = [name for name in pages() if is_run(name)]
every_page = pytest.mark.parametrize("name", RUN)


@pytest.fixture(scope="session")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All pages, drawn anew from the tables that git keeps."""
    folder = tmp_path_factory.mktemp("pages")
    kept = committed.with_report(folder) / "reports"
    if kept.parent == ROOT:  # without git
        kept = Path(shutil.copytree(kept, folder / "reports"))
    for name in RUN:
        page.write(name, kept)
    return kept


class Ids(HTMLParser):
    """The ids of a page, and where its links lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids, self.links = list[str](), list[str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if given.get("id"):
            self.ids.append(str(given["id"]))
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))


def html_of(reports: Path, name: str) -> str:
    return (reports / pages()[name].folder / "index.html").read_text("utf-8")


@pytest.mark.parametrize("name", [name for name in RUN if name != "report"])
def test_pages_in_git_are_those_that_their_tables_in_git_give(name: str, reports: Path) -> None:
    assert html_of(reports, name) == html_of(ROOT / "reports", name)
    drawn, kept = (
        sorted(path.name for path in (folder / pages()[name].folder / "figures").iterdir())
        for folder in (reports, ROOT / "reports")
    )
    assert drawn == kept


@every_page
def test_every_link_leads_somewhere_and_ids_are_distinct(reports: Path, name: str) -> None:
    folder = reports / pages()[name].folder
    parsed = Ids(html_of(reports, name))
    assert len(set(parsed.ids)) == len(parsed.ids)
    for link in parsed.links:
        place, _, part = link.partition("#")
        if "://" in place:
            continue
        target = (folder / place).resolve() if place else folder / "index.html"
        if target == (reports / "../README.md").resolve():
            continue
        assert target.exists(), link
        # the explorer is in the page of a run alone
        if part and part != "try":
            assert part in Ids(target.read_text("utf-8")).ids, link


@every_page
def test_a_page_needs_no_other_file_and_has_the_bar(reports: Path, name: str) -> None:
    text = html_of(reports, name)
    assert not re.search(r"<link|src=|@import", text)
    assert all(f">{title}</a>" in text for title in BAR)


def test_all_pages_together_are_small() -> None:
    places = [ROOT / "reports" / about.folder / "index.html" for about in pages().values()]
    assert sum(place.stat().st_size for place in places) <= 700_000


@every_page
def test_every_item_has_a_table_and_a_part(reports: Path, name: str) -> None:
    about = pages()[name]
    parts = {part.id for part in about.parts}
    files = {path.stem for path in (reports / about.folder / "tables").glob("*.csv")}
    for item in about.items:
        assert item.part in parts or not item.part
        assert item.source in files
        assert not item.draw or callable(getattr(figures, item.draw))
        if item.columns:
            frame = pd.read_csv(reports / about.folder / "tables" / f"{item.source}.csv")
            assert set(item.columns) <= set(frame.columns)


@every_page
def test_the_values_of_figures_lie_within_their_panels(reports: Path, name: str) -> None:
    listed = re.findall(
        r'<script type="application/json">(\{"by".*?)</script>', html_of(reports, name)
    )
    assert listed or not any(item.draw for item in pages()[name].items)
    for text in listed:
        values = json.loads(text)
        places = [at for at, _, _ in values["places"]]
        assert places == sorted(places)
        for at, place, shown in values["places"]:
            assert 0 <= at <= (values["width"] if values["by"] == "x" else values["below"])
            assert place
            assert all(text for _, text in shown)


@pytest.mark.parametrize("number", [1, 5, 9])
def test_a_legend_lies_within_its_panel(number: int) -> None:
    names = sorted(charts.PALETTE["models"], key=len)[-number:]
    frame = pd.DataFrame({"model": names, "epoch": 0, "MRR": 50.0})
    with mpl.rc_context(charts.PALETTE["settings"]):
        canvas = Figure((charts.WIDTH / 72, charts.HEIGHT / 72), layout="constrained")
        charts.draw_on(charts.lines(frame, "epoch", "MRR", "a title"), canvas)
        canvas.draw_without_rendering()
        box = canvas.legends[0].get_window_extent()
        assert 0 <= box.x0 < box.x1 <= charts.WIDTH
        assert box.y0 >= 0
        assert [text.get_text() for text in canvas.legends[0].get_texts()] == names


def test_values_have_their_place_and_their_interval() -> None:
    frame = pd.DataFrame(
        {"model": ["ES", "IU"], "size": 2, "MRR": [40.0, 50], "MRR low": [39.0, None]}
    ).assign(**{"MRR high": [41.04, None]})
    text, values = charts.alone(charts.lines(frame, "size", "MRR", "a title"), "one")
    ((_, place, shown),) = values["places"]
    assert place == "|ξ| = 2"
    shown = [[values["names"][name], value] for name, value in shown]
    assert shown == [["IU", "50.0"], ["ES", "40.0 [39.0, 41.0]"]]
    assert text.startswith("<svg")
    assert not re.search(r'<g|clip|font-(family|size)| [dxy]="[^"]*\.\d\d', text)


def test_a_page_is_drawn_as_far_as_there_are_tables(tmp_path: Path) -> None:
    frame = pd.DataFrame(
        {"graph": ["a"], "Xavier": [1.25], "Xavier low": [1.0], "Xavier high": [1.5]}
    )
    (tmp_path / "beyond" / "tables").mkdir(parents=True)
    frame.to_csv(tmp_path / "beyond" / "tables" / "graphs_novel_given.csv", index=False)
    text = page.write("beyond", tmp_path).read_text("utf-8")
    assert Ids(text).ids.count("figure-graphs") == 1
    assert "table-graphs_gains" not in Ids(text).ids
    assert {path.name for path in (tmp_path / "beyond" / "figures").iterdir()} == {
        "graphs.svg",
        "graphs.png",
    }


@pytest.mark.skipif("beyond" not in RUN, reason="git has no tables of this code yet")
def test_two_drawings_have_the_same_bytes(reports: Path, tmp_path: Path) -> None:
    shutil.copytree(reports / "beyond" / "tables", tmp_path / "beyond" / "tables")
    page.write("beyond", tmp_path)
    for path in (tmp_path / "beyond").rglob("*.*"):
        assert path.read_bytes() == (reports / path.relative_to(tmp_path)).read_bytes()


def test_a_table_shows_values_intervals_and_groups() -> None:
    frame = pd.DataFrame(
        {
            "model": ["a", "b"],
            "known: MRR": [71.23, None],
            "known: MRR low": [70.0, None],
            "known: MRR high": [72.5, None],
            "seeds": [30, 30],
        }
    )
    shown = page.shown_table(frame)
    assert [column.title for column in shown.columns] == ["model", "MRR", "seeds"]
    assert shown.columns[1].cells == [("71.2", "[70.0, 72.5]"), ("–", "")]
    assert shown.columns[2].cells[0] == ("30", "")
    assert shown.groups == [("", 1), ("earlier knowledge", 1), ("", 1)]
    only = page.shown_table(frame, ["model", "seeds"])
    assert only.groups == []


def test_an_item_shows_the_rows_that_it_names_and_without_them_all() -> None:
    frame = pd.DataFrame({"graph": ["a", "b"], "model": ["x", "y"], "MRR": [1.0, 2.0]})
    for graph, number in (("b", 1), ("c", 2)):
        shown = page.rendered(page.ReportItem(name="t", title="t", rows={"graph": [graph]}), frame)
        assert shown.table
        assert len(shown.table.rows) == number


RUN_TABLE = """name,value
experiments.a.sessions.seeds,30
experiments.b.sessions.seeds,5
experiments.b.finetuned.seeds,10
experiments.a.finetuned.seeds,None
commit,0123456789
date,2026-11-30
"""


def test_captions_have_their_seeds_and_their_run_as_far_as_they_are_known(tmp_path: Path) -> None:
    tables = page.PageTables(tmp_path)
    item = page.ReportItem(name="t", title="t", seeds=["a.sessions", "a.finetuned", "b.finetuned"])
    assert tables.made(item) == tables.made() == ""
    (tmp_path / "run.csv").write_text(RUN_TABLE, encoding="utf-8")
    known = page.PageTables(tmp_path / ".")
    assert known.made(item) == "10 or 30 seeds; run of commit 0123456789 (2026-11-30)"
    assert known.made() == "run of commit 0123456789 (2026-11-30)"


def test_prose_has_values_ranges_and_texts_of_tables(tmp_path: Path) -> None:
    frame = pd.DataFrame({"claim": list("abc"), "in it": ["no", "yes", "no"], "MRR": [1, 2, 3.5]})
    frame.to_csv(tmp_path / "t.csv", index=False)
    tables = page.PageTables(tmp_path)
    assert tables.number("t", "MRR", "c") == tables.number("t", "MRR", claim="c") == "3.5"
    assert tables.number("t", "MRR", "d") == tables.number("u", "MRR") == "–"
    assert tables.span("t", "MRR") == "1 to 3.5"
    assert tables.span("t", "MRR", in_it="yes") == "2"
    assert tables.span("u", "MRR") == "–"
    assert tables.quoted("t", "claim", in_it="no") == "“a”, “c”"
    assert tables.count("t", "claim", in_it="no") == 2
    assert tables.span("t", "MRR", claim=["a", "b"]) == "1 to 2"


def test_noise_is_not_drawn_large_and_no_axis_is_below_0() -> None:
    frame = pd.DataFrame({"model": "ES", "size": [1, 2], "MRR": [2.0, 2.5]})
    axes = Figure().subplots()
    charts.lines(frame, "size", "MRR", "a title").draw(axes)
    low, high = axes.get_ylim()
    assert low == 0
    assert high >= charts.LEAST


# Items and initializers of one's own


def with_item(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """The page ``beyond`` with its first item changed."""
    about = pages()["beyond"]
    item = about.items[0].model_copy(update=changes)
    changed = about.model_copy(update={"items": [item]})
    entries = {"beyond": changed.model_dump()}
    monkeypatch.setattr(page, "_ITEMS", Path("items.yaml"))
    monkeypatch.setattr(page.config, "read", lambda _: entries)
    pages.cache_clear()


@pytest.fixture
def _pages_anew() -> Iterator[None]:
    """Pages that a test changed are forgotten after it."""
    yield
    pages.cache_clear()


@pytest.mark.usefixtures("_pages_anew")
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"name": "strnog"}, r"beyond\.items\.strnog: expected the name of a table, got 'strnog'"),
        ({"name": "new", "part": "modles"}, r"beyond\.items\.new\.part: .*did you mean 'models'"),
        ({"name": "new", "draw": "strogn"}, r"beyond\.items\.new\.draw: .*did you mean 'strong'"),
    ],
)
def test_an_item_whose_table_or_part_or_figure_does_not_exist_is_refused_by_name(
    changes: dict[str, str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beyond" / "tables").mkdir(parents=True)
    with_item(monkeypatch, **changes)
    with pytest.raises(InputError, match=rf"items\.yaml: {expected}"):
        page.write("beyond", tmp_path)


def test_an_initializer_of_ones_own_is_in_the_figures_with_a_style_of_its_own() -> None:
    names = ["Xavier", "Nearest", "Farthest", "Soft hybrid"]
    frame = pd.DataFrame({"model": names, "size": 2, "scope": "weighted", "graph": "home"})
    (panel,) = figures.figure3a(frame.assign(MRR=50.0))
    canvas = Figure()
    values = panel.draw(canvas.subplots())
    shown = ["Xavier", "Nearest", "Farthest"]
    assert [value.name for value in values] == shown
    styles = [charts.style_of(name, shown) for name in shown]
    assert len({style["color"] for style in styles}) == len(shown)
    row = pd.DataFrame({"graph": ["home"], "ERS": 50.0, "Nearest": 60.0, "Nearest low": 55.0})
    (panel,) = figures.graphs(row.assign(**{"Nearest high": 65.0}))
    assert [value.name for value in panel.draw(Figure().subplots())] == ["ERS", "Nearest"]


def test_more_names_than_spare_colours_are_told_apart_by_dash_and_mark() -> None:
    names = [f"own {number}" for number in range(20)]
    styles = [tuple(charts.style_of(name, names).values()) for name in names]
    assert len(set(styles)) == len(names)
