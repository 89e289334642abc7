"""The report on other graphs, for two small graphs beside a small experiment."""

from dataclasses import replace

import pandas as pd
import pytest

from isi.report.data import Results, VariantRuns
from isi.report.sections import variants
from tests.reports import of_experiment, shown, small_results
from tests.variants import ENTITIES, TRIPLES, Given, queries_of, runs_of, variant

GIVEN = {
    "xavier": [0.1, 0.3],
    "es": [0.5, 0.6],
    "kind_mean": [0.5, 0.7],
    "ers": [0.6, 0.6],
    "joint": [0.9, 0.9],
}


def graph(title: str, given: Given = GIVEN) -> VariantRuns:
    (runs,) = variant(
        "graphs", {title: given}, {}, later={("es", 0): [0.1, 0.9], ("joint", 0): [0.9]}
    )
    return replace(runs, title=title, entities=ENTITIES, triples=TRIPLES)


def results_with(*graphs: VariantRuns) -> Results:
    return replace(small_results(["home"], studies=False), other_graphs=graphs)


def test_sizes_and_how_far_the_kind_of_a_tail_determines_the_relation_by_hand() -> None:
    assert variants.sizes([graph("lab")]) == [
        {
            "graph": "lab",
            "observations": 10,
            "unique triples": 4,
            "relations": 3,
            "entities": 4,
            "kinds": "2 object, 1 room, 1 affordance",
            "predicted by kind %": pytest.approx(75),
        }
    ]


def test_graphs_share_entities_of_the_same_phrase() -> None:
    other = ENTITIES[:2].assign(entity=["cup", "mug"], phrase=["cupboard", "tumbler"])
    rows = variants.shared([graph("lab"), replace(graph("shop"), entities=other)])
    assert [(row["lab"], row["shop"]) for row in rows] == [(4, 1), (1, 2)]


def test_every_graph_has_its_row_with_paired_differences_and_epochs() -> None:
    text, tables, (figure,) = shown("other_graphs", results_with(graph("lab"), graph("shop")))
    about = tables["graphs_novel_given"].set_index("graph")
    assert about.index.tolist() == ["lab", "shop"]
    assert about.loc["lab", ["Xavier", "ES", "ERS", "Joint"]].tolist() == pytest.approx(
        [20, 55, 60, 90]
    )
    gains = tables["graphs_gains"].set_index("graph").loc["lab"]
    assert gains["ERS minus Xavier"] == pytest.approx(40)
    assert gains[["ERS minus Xavier low", "ERS minus Xavier high"]].tolist() == pytest.approx(
        [30, 50]
    )
    assert gains["ERS minus Kind mean"] == pytest.approx(0)
    assert "Soft hybrid minus ERS" not in gains
    assert tables["graphs_epochs"].set_index("graph").loc["lab", "ES"] == 1
    assert tables["graphs"]["graph"].tolist()[-2:] == ["lab", "shop"]
    assert "ERS is significantly above Xavier on 2 of 2 graphs and " in text
    assert "ERS is significantly above Kind mean on 0 of 2 graphs." in text
    assert [tick.get_text() for tick in figure.canvas.axes[0].get_yticklabels()] == ["lab", "shop"]


def test_a_main_experiment_stands_before_the_others_by_its_runs_of_their_size() -> None:
    at_five = runs_of(
        "home", dict.fromkeys(GIVEN, 0.4), {("es", 0): [0.1, 0.1, 0.9], ("joint", 0): [0.9]}
    )
    queries = queries_of("home", {**GIVEN, "es": [0.2, 0.4], "joint": [0.7, 0.9]})
    runs, answers = (
        pd.concat([frame.assign(size=2, mrr_star=0.01), frame]) for frame in (at_five, queries)
    )
    results = of_experiment(results_with(graph("lab")), "home", runs=runs, queries=answers)
    text, tables, (figure,) = shown("other_graphs", results)
    title = results.experiments["home"].title
    about = tables["graphs_novel_given"].set_index("graph")
    assert about.index.tolist() == [title, "lab"]
    assert about.loc[title, ["Xavier", "ES", "ERS", "Joint"]].tolist() == pytest.approx(
        [20, 30, 60, 80]
    )
    assert tables["graphs_immediate"].set_index("graph").loc[
        [title, "lab"], "ES"
    ].tolist() == pytest.approx([40, 50])
    assert tables["graphs_gains"].set_index("graph").loc[
        title, "ERS minus Xavier"
    ] == pytest.approx(40)
    assert tables["graphs_epochs"].set_index("graph").loc[title, "ES"] == 2
    assert "ERS is significantly above Xavier on 2 of 2 graphs" in text
    assert [tick.get_text() for tick in figure.canvas.axes[0].get_yticklabels()] == [title, "lab"]


def test_a_loss_is_called_one() -> None:
    worse = GIVEN | {"ers": [0.0, 0.1]}
    text, _, _ = shown("other_graphs", results_with(graph("lab"), graph("shop", worse)))
    assert "ERS is significantly above Xavier on 1 of 2 graphs (below on 1)" in text


def test_nothing_is_said_where_no_graph_has_run() -> None:
    assert shown("other_graphs", small_results(["home"])) == ("", {}, [])
