"""What the report says of other graphs, against two small ones beside a small experiment."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from isi.report.results import Asked, Results
from isi.report.sections import graphs
from isi.report.varied import Explored
from tests.reports import small_results
from tests.test_beyond_report import About, asked_of, made, runs_of, variant

ENTITIES = pd.DataFrame({"entity": ["mug", "cup board", "kitchen", "open"],
                         "kind": ["object", "object", "room", "affordance"],
                         "phrase": ["mug", "cupboard", "kitchen", "open"]})  # fmt: skip
TRIPLES = pd.DataFrame(
    [("mug", "atLocation", "kitchen", 3), ("mug", "atLocation", "cup board", 2), ("mug", "nextTo", "cup board", 4),
     ("cup board", "hasAffordance", "open", 1)], columns=["head", "relation", "tail", "count"],
)  # fmt: skip


def explored(title: str, about: About, entities: pd.DataFrame = ENTITIES) -> Explored:
    ran = variant("graphs", {title: about}, {}, later={("es", 0): [0.1, 0.9], ("joint", 0): [0.9]})
    return Explored(entities, TRIPLES, replace(ran, how=ran.how.model_copy(update={"title": title})))


def results_with(*found: Explored) -> Results:
    return replace(small_results(["home"], studies=False), explored={one.ran.how.title: one for one in found})


ABOUT = {"xavier": [0.1, 0.3], "es": [0.5, 0.6], "kind_mean": [0.5, 0.7], "ers": [0.6, 0.6], "joint": [0.9, 0.9]}


def test_sizes_and_how_far_the_kind_of_a_tail_tells_the_relation_by_hand() -> None:
    frame = graphs.sizes({"lab": (ENTITIES, TRIPLES)})
    assert frame.to_dict("records") == [
        {"graph": "lab", "observations": 10, "unique triples": 4, "relations": 3, "entities": 4,
         "kinds": "2 object, 1 room, 1 affordance", "told by kind %": pytest.approx(75)}
    ]  # fmt: skip


def test_graphs_share_entities_of_the_same_phrase() -> None:
    other = ENTITIES[:2].assign(entity=["cup", "mug"], phrase=["cupboard", "tumbler"])
    frame = graphs.shared({"lab": (ENTITIES, TRIPLES), "shop": (other, TRIPLES)}).set_index("graph")
    assert frame.to_numpy().tolist() == [[4, 1], [1, 2]]


def test_every_graph_has_its_row_with_paired_differences_and_epochs() -> None:
    text, tables, (figure,) = made(graphs.SECTION, results_with(explored("lab", ABOUT), explored("shop", ABOUT)))
    about = tables["graphs_asked_about"].set_index("graph")
    assert about.index.tolist() == ["lab", "shop"]
    assert about.loc["lab", ["Xavier", "ES", "ERS", "Joint"]].tolist() == pytest.approx([20, 55, 60, 90])
    gains = tables["graphs_gains"].set_index("graph").loc["lab"]
    assert gains["ERS less Xavier"] == pytest.approx(40)
    assert gains[["ERS less Xavier low", "ERS less Xavier high"]].tolist() == pytest.approx([30, 50])
    assert gains["ERS less Kind mean"] == pytest.approx(0)
    assert "Soft hybrid less ERS" not in gains
    assert tables["graphs_epochs"].set_index("graph").loc["lab", "ES"] == 1
    assert tables["graphs"]["graph"].tolist()[-2:] == ["lab", "shop"]
    assert "ERS is above Xavier on 2 of 2 (and below on 0)" in text
    assert "ERS is above Kind mean on 0 of 2 (and below on 0)" in text
    assert [tick.get_text() for tick in figure.canvas.axes[0].get_xticklabels()] == ["lab", "shop"]


def test_a_main_experiment_stands_before_the_others_by_its_runs_of_their_size() -> None:
    at_five = runs_of("home", dict.fromkeys(ABOUT, 0.4), {("es", 0): [0.1, 0.1, 0.9], ("joint", 0): [0.9]})
    queries = asked_of("home", {**ABOUT, "es": [0.2, 0.4], "joint": [0.7, 0.9]})
    runs, asked = (
        pd.concat([frame.assign(size=2, mrr_star=0.01), frame]).drop(columns="experiment")
        for frame in (at_five, queries)
    )
    results = results_with(explored("lab", ABOUT))
    home = replace(results.experiments["home"], runs=runs)
    results = replace(results, experiments={"home": home}, asking={"home": Asked(asked, pd.DataFrame())})
    text, tables, (figure,) = made(graphs.SECTION, results)
    title = home.title
    about = tables["graphs_asked_about"].set_index("graph")
    assert about.index.tolist() == [title, "lab"]
    assert about.loc[title, ["Xavier", "ES", "ERS", "Joint"]].tolist() == pytest.approx([20, 30, 60, 80])
    assert tables["graphs_at_once"].set_index("graph").loc[[title, "lab"], "ES"].tolist() == pytest.approx([40, 50])
    assert tables["graphs_gains"].set_index("graph").loc[title, "ERS less Xavier"] == pytest.approx(40)
    assert tables["graphs_epochs"].set_index("graph").loc[title, "ES"] == 2
    assert "ERS is above Xavier on 2 of 2 (and below on 0)" in text
    assert [tick.get_text() for tick in figure.canvas.axes[0].get_xticklabels()] == [title, "lab"]


def test_nothing_is_said_where_no_graph_has_run() -> None:
    assert list(graphs.SECTION.contents(small_results(["home"]))) == []
