"""The whole page: it has a section for each analysis that was run, and no other."""

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from markupsafe import Markup

from isi.experiment.insert import FullCurves
from isi.initializers.api import INITIALIZERS, Registered
from isi.report import page
from isi.report.data import Results
from isi.report.figures import Figure
from isi.report.page import Page, best_rows, metrics, plots
from isi.report.section import Block, Content, FilledSection, ReportSection
from isi.report.sections.paper import comparison
from isi.report.sections.run import table1
from isi.report.tables import Column, Estimate, ReportTable
from isi.report.words import colour, contenders, controls
from tests.prose import crowded, prose_of
from tests.reports import (
    GRAPHS,
    ROOT,
    frame_of,
    of_experiment,
    paper,
    small_results,
    svg_alone,
    with_settings,
)
from tests.reports import INITIALIZERS as SHIPPED
from tests.variants import beyond_of

REPORT = Page.of("report")
ANALYSES = {
    "query-breakdown",
    "trajectory",
    "explorer",
    "indicators",
    "cross-validation",
    "embedding-models",
    "affordances",
}
CASES = [
    (("home",), False),
    (("away",), False),
    (("moved",), False),
    (("moved", "home"), True),
    (tuple(GRAPHS), True),
]


@cache
def results_of(experiments: tuple[str, ...] = tuple(GRAPHS), analyses: bool = True) -> Results:
    return small_results(experiments, analyses)


@cache
def parts_of(results: Results) -> list[FilledSection]:
    """All sections with content."""
    return [part for section in REPORT.sections if (part := section.filled(results))]


def names(results: Results, kind: type[ReportTable] | type[Figure]) -> list[str]:
    return [
        block.content.name
        for part in parts_of(results)
        for block in part.blocks
        if isinstance(block.content, kind)
    ]


def table_of(results: Results, name: str) -> ReportTable:
    (found,) = (
        block.content
        for part in parts_of(results)
        for block in part.blocks
        if isinstance(block.content, ReportTable) and block.content.name == name
    )
    return found


def rendered(results: Results) -> str:
    answer = REPORT.answer.filled(results) if REPORT.answer else None
    figures = dict.fromkeys([*names(results, Figure), "answer"], Markup("<svg></svg>"))
    return REPORT.html(parts_of(results), answer, figures, results)


@pytest.mark.parametrize(("experiments", "analyses"), CASES)
def test_any_experiments_and_analyses_make_a_whole_page(
    experiments: tuple[str, ...], analyses: bool
) -> None:
    results = results_of(experiments, analyses)
    text, ids = rendered(results), {part.id for part in parts_of(results)}
    assert (ANALYSES & ids) == (ANALYSES if analyses else set())
    assert ("transfer" in ids) == ("moved" in experiments)
    assert ({"immediate", "convergence", "paper"} <= ids) == any(
        name != "moved" for name in experiments
    )
    found = re.findall(r'id="([^"]+)"', text)
    assert len(set(found)) == len(found)
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(found)
    for kind in (ReportTable, Figure):
        assert len(set(names(results, kind))) == len(names(results, kind))
    assert json.loads(json.dumps(metrics(results)))["immediate_mrr_star"]["all"].keys() == {
        *SHIPPED,
        "joint",
    }
    assert "nan" not in re.sub(r"<[^>]*>", " ", text).lower().split()


def test_the_first_graph_has_plain_names_and_others_bear_their_own() -> None:
    everything = results_of()
    figures, tables = set(names(everything, Figure)), set(names(everything, ReportTable))
    for name in ("figure3a_immediate", "figure3b_curves", "forgetting"):
        assert {name, f"{name}_away"} <= figures
    for name in (
        "immediate",
        "improvement",
        "table2_convergence",
        "differences",
        "graph_totals",
        "parts_of_the_gain",
    ):
        assert {name, f"{name}_away"} <= tables
    assert "figure4_moved" in figures
    assert {"moved_mined", "moved_immediate", "table1_graph_statistics"} <= tables
    assert "table1_graph_statistics_away" not in tables  # which tells no scenes apart
    drawn = plots(everything)
    absent = {"transfer_known", "transfer_known_closed"}  # dvc.yaml names them
    assert all(drawn.pop(name).empty for name in absent)
    assert set(drawn) == {
        *(f"immediate_{scope}{suffix}" for scope in ("all", "novel") for suffix in ("", "_away")),
        *(
            f"{name}_{scope}{suffix}"
            for name, suffix in (("curves", ""), ("curves", "_away"), ("moved", ""))
            for scope in ("all", "novel_heldout", "known", "known_closed")
        ),
    }


def test_training_with_nothing_inserted_stands_beside_the_others_where_it_ran() -> None:
    results = results_of()
    more = results
    for name in ("home", "moved"):
        runs, analyses = results.experiments[name].runs, results.experiments[name].analyses
        of_es = runs[(runs["model"] == "es") & (runs["scope"] == "known_closed")]
        alone = of_es.assign(mrr_star=of_es["mrr_star"] + 0.01).drop(columns="model")
        more = of_experiment(more, name, analyses={**analyses, "finetune_only": alone})
    tables = [
        table_of(more, "forgetting"),
        table_of(more, "forgetting_away"),
        table_of(results, "forgetting"),
    ]
    assert ["Nothing inserted" in set(table.frame["model"]) for table in tables] == [
        True,
        False,
        False,
    ]
    ended = table_of(more, "moved_at_the_end").frame
    es = ended[(ended["first"] == "ES") & (ended["second"] == "Nothing inserted")]
    assert es["difference"].tolist() == pytest.approx([-1])


def test_metrics_hold_each_other_experiment_under_its_name() -> None:
    everything = results_of()
    found = metrics(everything)
    home, moved = everything.experiments["home"], everything.experiments["moved"]
    own = home.immediate[(home.immediate["scope"] == "novel") & (home.immediate["model"] == "rs")]
    assert found["immediate_mrr_star"]["novel"]["rs"] == pytest.approx(
        100 * own["mrr_star"].mean(), abs=6e-3
    )
    assert found["graph"] == {"observations": 6, "unique_triples": 3, "entities": 4}
    assert list(found["away"]) == [name for name in found if name not in ("away", "moved")]
    there = moved.immediate[
        (moved.immediate["scope"] == "all") & (moved.immediate["model"] == "es")
    ]
    assert found["moved"]["immediate_mrr_star"]["all"]["es"] == pytest.approx(
        100 * there["mrr_star"].mean(), abs=6e-3
    )
    assert {"drop_percent", "known_closed_at_the_end", "affordances_percent"} <= set(found["moved"])
    assert "affordances_percent" not in found  # they are those of the other study


def test_the_paper_stands_beside_every_graph_of_its_own() -> None:
    everything = results_of()
    tables = [
        table_of(everything, name).frame.set_index(["where", "what"])
        for name in ("paper_against_this_run", "papers_other_numbers")
    ]
    assert list(tables[0].columns) == ["paper", "this run", "away", "this run is"]
    assert list(tables[1].columns) == ["paper", "this run", "away", "note"]
    frame = pd.concat(tables)
    assert frame.index.is_unique
    home, away = frame["this run"], frame["away"]
    assert home["section 5.1", "unique triples"] == away["section 5.1", "unique triples"] == 3
    assert home["section 5.1", "household concepts: objects and rooms"] == 3
    for name, column in (("home", home), ("away", away)):
        cells = everything.experiments[name].convergence
        for scope, words in (
            ("all", ""),
            ("novel_heldout", ", on held-out triples of the novel entities instead"),
        ):
            own = cells[(cells["scope"] == scope) & (cells["model"] == "es")]["epochs"]
            assert column["Table 2", f"ES: epochs to convergence, mean{words}"] == pytest.approx(
                own.mean()
            )
    # home, which is extended, has numbers of the transfer; away has none, and it has no scenes
    moved = [key for key in frame.index if key[0] in ("section 6.3", "Table 3")]
    studied = [
        key for key in frame.index if "cross-validation" in key[1] or "the rule picks" in key[1]
    ]
    assert home[[*moved, *studied]].notna().all()
    assert away[[*moved, *studied]].isna().all()
    assert not [key for key in frame.index if "largest set" in key[1]]  # equal by construction
    # settings, sizes of graphs and what follows from other numbers are no results
    assert len(tables[0]) == 28
    places = {"section 5.3", "section 6.1", "Table 2", "section 6.3"}
    assert {place for place, _ in tables[0].index} == places
    for key, row in tables[0].iterrows():
        theirs, ours = row["paper"], row["this run"]
        assert row["this run is"] == (
            ""
            if np.isnan(theirs) or np.isnan(ours)
            else "agrees"
            if 0.9 * theirs <= ours <= 1.1 * theirs
            else "larger"
            if ours > theirs
            else "smaller"
        ), key
    verdicts = ("plausible", "unlikely", "wrong")
    assert (
        sum(
            home["Table 3", f"RS: of 4 answers shown, how many are {verdict}"]
            for verdict in verdicts
        )
        == 4
    )
    assert home["Table 1", "kitchen: rooms"] == 1
    assert np.isnan(away["Table 1", "kitchen: rooms"])


@pytest.mark.parametrize("table", ["paper_against_this_run", "papers_other_numbers"])
def test_every_number_of_the_paper_has_a_row_whatever_was_run(table: str) -> None:
    few, all_of_it = (
        table_of(found, table).frame[["where", "paper"]]
        for found in (results_of(("away",), False), results_of())
    )
    pd.testing.assert_frame_equal(few, all_of_it)


OWN = """# One | open

There are {{ number }} `experiments`; see [nothing](#nothing) and [this](#one).

- first <b>
- second

@table own_table | A table | folded
Of two
rows.
"""


def test_a_section_without_contents_is_left_out_and_one_more_is_one_more(tmp_path: Path) -> None:
    results = results_of(("away",), False)

    def one(found: Results) -> Iterator[Content]:
        yield Content({"number": len(found.experiments)}, {"own_table": [{"a": 1}, {"a": 2}]})

    (tmp_path / "tables").mkdir()
    (tmp_path / "tables/of_an_earlier_run.csv").touch()
    sections = [
        ReportSection("none", lambda _: [], OWN),
        ReportSection("one", one, OWN),
        ReportSection.of("immediate.immediate"),
    ]
    Page("report", sections, REPORT.answer).write(tmp_path, results)
    text = (tmp_path / "index.html").read_text("utf-8")
    for part in (
        '<section id="one"><details class="part" open><summary><h3>One</h3></summary>',
        "Of two rows.",
        'There are 1 <code>experiments</code>; see nothing and <a href="#one">this</a>.',
        "<li>first &lt;b&gt;</li>",
    ):
        assert part in text
    assert 'id="none"' not in text
    assert text.index('href="#one"') < text.index('href="#immediate"')
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        f"{name}.{form}"
        for name in ("figure3a_immediate", "gain_and_cost", "answer")
        for form in ("svg", "png")
    }
    assert (tmp_path / "tables/own_table.csv").read_text("utf-8") == "a\n1\n2\n"
    assert not (tmp_path / "tables/of_an_earlier_run.csv").exists()
    assert json.loads((tmp_path / "metrics.json").read_text("utf-8")) == metrics(results)


def test_without_a_size_of_full_curves_there_is_no_curve_and_the_page_says_so() -> None:
    other = with_settings(results_of(("home",), False), "home", full_curves=FullCurves(sizes=[99]))
    assert "forgetting" not in names(other, ReportTable)
    assert "figure3b_curves" not in names(other, Figure)
    assert rendered(other).count("No set size with full learning curves was inserted") == 2


def test_several_sessions_stand_apart_and_each_converges_against_its_own_joint_model() -> None:
    results = results_of(("home",), False)
    home = results.experiments["home"]
    assert "sessions" not in names(results, ReportTable)
    two = with_settings(
        results, "home", sessions=home.settings.sessions.model_copy(update={"steps": 2})
    )
    runs = home.runs
    # out of reach
    second = runs.assign(session=2, mrr_star=runs["mrr_star"].mask(runs["model"] == "joint", 2.0))
    other = replace(two.experiments["home"], runs=pd.concat([runs, second]))
    assert other.convergence.groupby("session")["converged"].mean()[2] == 0
    first = other.convergence[other.convergence["session"] == 1].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, home.convergence)
    both = replace(two, experiments={"home": other})
    assert "sessions" in names(both, ReportTable)
    rendered(both)


def test_runs_that_params_do_not_list_take_no_part() -> None:
    fewer = {"initializers": {"xavier": {}, "es": {"k": 8}}, "plots": {"initializers": []}}
    listed = small_results(["home"], studies=False, **fewer, **{"sweep.initializers": {"es": {}}})
    assert listed.experiments["home"].models == ["xavier", "es", "joint"]
    text = rendered(listed)
    assert "Permuted" not in text
    assert 'id="controls"' not in text


def test_table_1_has_the_rooms_and_relations_of_its_source() -> None:
    rows = [
        ("s1", "cellar", "wine", "liesIn", "rack"),
        ("s1", "cellar", "rack", "atLocation", "cellar"),
        ("s2", "kitchen", "cup", "atLocation", "kitchen"),
        ("s2", "kitchen", "jug", "atLocation", "kitchen"),
        ("s3", "kitchen", "cup", "atLocation", "kitchen"),
    ]
    observations = pd.DataFrame(rows, columns=["scene", "room", "head", "relation", "tail"])
    values, vocabulary = paper()
    table = table1(observations, values["graph"]["median_per_environment"], vocabulary["relations"])
    frame = frame_of(table).set_index("room")
    assert list(frame.index) == ["kitchen", "cellar", "all"]
    assert frame.loc[
        "kitchen", ["location", "location (paper)", "liesIn", "object types", "rooms"]
    ].tolist() == [
        1.5,
        59.5,
        0,
        1.5,
        2,
    ]
    assert frame.loc["cellar", ["location", "liesIn", "rooms"]].tolist() == [1, 1, 1]
    assert np.isnan(frame.loc["cellar", "location (paper)"])
    assert "liesIn (paper)" not in frame


def test_ones_own_initializers_take_spare_colours_and_all_differ(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = ["own", "another"]
    for name in own:
        plain = Registered(name, lambda insertion: insertion, name.capitalize(), "own", None)
        monkeypatch.setitem(INITIALIZERS._registered, name, plain)
    models = ["own", *SHIPPED, "another", "joint"]
    colours = [colour(model, models) for model in models]
    assert len(set(colours)) == len(models)
    assert colour("es", models) == INITIALIZERS.get("es", "").colour
    assert contenders(models) == ["own", "xavier", "iu", "es", "rs", "ers", "another"]
    assert controls(models) == ["mean", "es_permuted"]


def files_of(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}


def test_equal_results_make_equal_bytes(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        immediate = Page("report", [ReportSection.of("immediate.immediate")])
        immediate.write(tmp_path / folder, small_results(["home"], studies=False))
    one, other = (files_of(tmp_path / folder) for folder in ("one", "other"))
    assert len(one) > 5
    assert one == other


def test_the_report_does_not_know_the_second_pipeline_which_has_its_own_page(
    tmp_path: Path,
) -> None:
    plain = results_of(("home",), False)
    with svg_alone():
        for folder, results in (("plain", plain), ("more", beyond_of(plain))):
            REPORT.write(tmp_path / folder, results)
        Page.of("beyond").write(tmp_path / "beyond", beyond_of(plain))
    plain_files, more, beyond = (
        files_of(tmp_path / folder) for folder in ("plain", "more", "beyond")
    )
    assert plain_files == more
    assert {Path("index.html"), Path("tables/causes.csv"), Path("figures/graphs.svg")} <= {*beyond}
    assert not {Path("metrics.json"), Path("tables/immediate.csv")} & beyond.keys()


def test_the_page_beyond_the_paper_has_a_part_for_each_group_that_was_run() -> None:
    results = beyond_of(results_of(("home",), False))
    sections = [section.name for section in Page.of("beyond").sections]
    parts = [part for section in Page.of("beyond").sections if (part := section.filled(results))]
    assert [part.id.replace("-", "_") for part in parts] == sections
    drawn = [
        block.content.name
        for part in parts
        for block in part.blocks
        if isinstance(block.content, Figure)
    ]
    text = Page.of("beyond").html(parts, None, dict.fromkeys(drawn, Markup("<svg></svg>")), results)
    ids = re.findall(r'id="([^"]+)"', text)
    assert len(set(ids)) == len(ids)
    assert set(re.findall(r'href="#([^"]+)"', text)) <= {*ids}
    assert '<section id="answer"' not in text
    without = results_of(("home",), False)
    assert not any(section.filled(without) for section in Page.of("beyond").sections)


def test_the_places_of_the_papers_figures_and_tables_are_those_of_the_page() -> None:
    places = page.PAGES["paper"]
    text = rendered(results_of())
    (strip,) = re.findall(r'<div class="places">.*?</div>', text)
    assert dict(re.findall(r'<a href="#([^"]+)">([^<]+)</a>', strip)) == {
        place: str(title)
        for title, place in places.items()
        if not place.endswith(("4_transfer", "transfer_immediate"))
    }
    few = rendered(results_of(("away",), False))
    assert set(
        re.findall(r'href="#([^"]+)"', re.findall(r'<div class="places">.*?</div>', few)[0])
    ) < set(places.values())


# Tables


def test_the_best_of_a_column_is_among_models_but_the_joint_one() -> None:
    rows = [
        ("Xavier", 40.04, 70, 9, 1),
        ("ES", 40.01, 60, 2, 2),
        ("RS", 39, None, 5, 3),
        ("Joint", 90, 95, None, 4),
    ]
    names = ("model", "all", "novel", "mean", "other")
    table = ReportTable.of(
        "t",
        [
            {"model": model}
            | {
                name: value and Estimate(value)
                for name, value in zip(names[1:], values, strict=True)
            }
            for model, *values in rows
        ],
    )
    # all: both are shown as 40.0; epochs (mean): the lowest; a column of another name has no best
    assert best_rows(table) == {1: {0, 1}, 2: {0}, 3: {1}}


def test_a_column_of_one_model_and_a_table_of_other_rows_have_no_best() -> None:
    alone = [{"model": "ES", "all": Estimate(40.0)}, {"model": "Joint", "all": Estimate(90.0)}]
    assert best_rows(ReportTable.of("t", alone)) == {}
    of_scopes = [
        {"scope": scope, "model": "ES", "all": Estimate(40.0)} for scope in ("all", "novel")
    ]
    assert best_rows(ReportTable.of("t", of_scopes)) == {}
    assert (
        best_rows(ReportTable.of("t", [{"model": "ES", "all": 40.0}, {"model": "RS", "all": 50.0}]))
        == {}
    )


def test_the_papers_value_stands_below_ours_on_the_page_and_beside_it_in_files() -> None:
    rows = [
        {"model": "ES", "mean": 5.0, Column("mean", "paper", below=True): 16.6},
        {"model": "Mean", "mean": 7.0, Column("mean", "paper", below=True): None},
    ]
    table = ReportTable.of("t", rows)
    layout = [(place, column.name, below) for place, column, below in table.layout]
    assert layout == [(0, "model", None), (1, "mean", 2)]
    assert list(table.frame.columns) == ["model", "mean", "paper: mean"]
    block = Block("table", "Text.", title="Table", content=table)
    section = FilledSection("s", "Section", True, [block])
    text = Page("report", []).html([section], None, {}, results_of(("home",), False))
    assert re.findall(r"<td[^>]*>(.*?)</td>", text) == ["5<small>paper 16.6</small>", "7"]


def test_a_sentence_of_the_page_has_few_numbers() -> None:
    assert crowded(prose_of(rendered(results_of()))) == []
    committed_page = ROOT / "reports/index.html"
    if committed_page.exists():
        assert crowded(prose_of(committed_page.read_text("utf-8"))) == []


def test_the_foot_names_what_can_be_checked_and_no_time() -> None:
    text = rendered(results_of())
    (foot,) = re.findall(r"<footer>.*?</footer>", text, re.DOTALL)
    for part in ("home, away and shop", "make repro", "CITATION.cff", "MIT", "git log -1"):
        assert part in foot
    numbers = f"{json.dumps(metrics(results_of()), indent=2)}\n".encode()
    assert re.findall(r"\b[0-9a-f]{7,64}\b", foot) == [hashlib.sha256(numbers).hexdigest()[:12]]
    assert not re.search(r"20\d\d-\d\d", foot)


def test_further_graphs_have_links_to_their_files_alone() -> None:
    blocks = [block for part in parts_of(results_of()) for block in part.blocks]
    further = [
        block
        for block in blocks
        if isinstance(block.content, ReportTable | Figure) and block.content.name.endswith("_away")
    ]
    assert {block.kind for block in further} == {"data"}
    text = rendered(results_of())
    assert 'href="tables/immediate_away.csv"' in text
    assert 'id="table-immediate_away"' not in text
    lists = re.findall(r'<details class="table files-only">.*?</details>', text, re.DOTALL)
    assert len(re.findall('<section id="', text)) > len(lists) > 5
    assert all("<summary>More tables" in one for one in lists)
    assert 'class="data"' not in text


def test_the_page_of_this_repository_is_small() -> None:
    path = ROOT / "reports/index.html"
    if not path.exists():
        pytest.skip("the pipeline has not run")
    text = path.read_text("utf-8")
    assert path.stat().st_size <= 1_100_000
    assert (
        len(re.findall(r"<[a-z]", re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)))
        <= 12_000  # the explorer draws a thousand more
    )


def test_every_table_and_figure_of_a_section_has_its_place_in_the_template() -> None:
    results = results_of()
    parts = {part.id: part for part in parts_of(results)}
    for section in REPORT.sections:
        made = {
            f"{name}{content.suffix}"
            for content in section.contents(results)
            for name in (*content.tables, *content.figures)
        }
        part = parts.get(section.name.replace("_", "-"))
        contents = [block.content for block in part.blocks] if part else []
        placed = {content.name for content in contents if isinstance(content, ReportTable | Figure)}
        assert {name.removesuffix("_away") for name in made - placed} <= {"sessions"}, section.name


@pytest.mark.parametrize(
    ("paper_has", "ours", "said"),
    [
        (10, 10, "agrees"),
        (10, 11, "agrees"),
        (10, 9, "agrees"),
        (10, 11.1, "larger"),
        (10, 8.9, "smaller"),
        (0, 0, "agrees"),
        (0, 1, "larger"),
        (-10, -10.5, "agrees"),
        (-10, -5, "larger"),
        (-10, -20, "smaller"),
        (np.nan, 1, ""),
        (1, np.nan, ""),
    ],
)
def test_a_number_agrees_within_a_tenth_of_the_papers(
    paper_has: float, ours: float, said: str
) -> None:
    assert comparison(paper_has, ours) == said
