"""The data that the report gives to the explorer, against values by hand."""

import pandas as pd

from isi.report.section import Content
from isi.report.sections import insertions
from isi.report.sections.insertions import indicators_of, maps_of, queries_of, start
from tests.reports import of_experiment, small_results

STEPS = [("joint", 0), ("es", 0)]


def shown(**changes: pd.DataFrame) -> list[Content]:
    """The explorer section of small results in which ``changes`` replace tables of the explorer."""
    results = small_results(["home"])
    tables = results.experiments["home"].analyses["explorer"]
    return list(insertions.explorer(of_experiment(results, "home", analyses={"explorer": {**tables, **changes}})))


def test_queries_by_hand() -> None:
    rows = [
        ("joint", 0, 7, 1, None), ("joint", 0, 9, 2, "held_out"), ("joint", 0, 4, 5, "told"),
        ("es", 0, 4, 1, "told"), ("es", 0, 6, 2, None), ("es", 0, 9, 8, "held_out"),
    ]  # fmt: skip
    columns = ["model", "epoch", "answer", "rank", "true"]
    asked = pd.DataFrame(rows, columns=columns).assign(entity=3, relation="on", hidden="tail")
    vain = pd.DataFrame([(*step, 5, 1, None) for step in STEPS], columns=columns)
    vain = vain.assign(entity=3, relation="in", hidden="head")
    assert queries_of(pd.concat([vain, asked]), 2, STEPS, ["in", "on"]) == {3: [
        {"relation": 1, "hidden": 0, "true": [4, 9], "status": [1, 3],
         "first": [[7, 9], [4, 6]], "ranks": [[5, 2], [1, 8]]},
        {"relation": 0, "hidden": 1, "true": [], "status": [], "first": [[5], [5]], "ranks": [[], []]},
    ]}  # fmt: skip


def test_indicators_by_hand() -> None:
    rows = pd.DataFrame({
        "entity": [3, 3, 3, 4], "model": ["es", "es", "es", "rs"], "fallback": ["rs", "rs", "rs", None],
        "indicator": [8, 2, 5, 1], "weight": [0.6, 0.396, 0.004, 1.0], "by_words": [None, 0.126, 0.5, -0.2],
        "by_relations": [0.994, None, 0.1, 0.0],
    })  # fmt: skip
    assert indicators_of(rows) == {
        (3, "es"): {"fallback": "rs", "ids": [8, 2], "weight": [60, 40], "words": [None, 13], "relations": [99, None]},
        (4, "rs"): {"fallback": None, "ids": [1], "weight": None, "words": [-20], "relations": [0]},
    }


def test_maps_by_hand() -> None:
    known = pd.DataFrame({"seed": [1, 1, 0], "entity": [5, 6, 7], "x": [0.12345, -1, 0], "y": [0.5, 2, -0.0004]})
    rows = pd.DataFrame({"entity": [3, 4, 5], "seed": [0, 1, 1], "shown": [0.347, 0.5, 0.5], "fitted": [0.1, 1, 1.0]})
    assert maps_of(known, rows) == {
        "0": {"known": [7], "at": [[0, 0]], "shown": 35, "fitted": 10},
        "1": {"known": [5, 6], "at": [[12, 50], [-100, 200]], "shown": 50, "fitted": 100},
    }


def test_it_starts_with_most_insert_triples_among_the_most_common_kind() -> None:
    experiment = small_results(["home"]).experiments["home"]  # cup, kitchen, break, table: two of them are objects
    assert start(experiment, pd.Series({0: 2, 1: 9, 3: 4})) == 3
    assert start(experiment, pd.Series({1: 9, 2: 4})) == 1  # no object is shown


def test_entities_in_no_set_are_named() -> None:
    (content,) = shown()
    assert content.numbers["absent"] == ["kitchen", "break"]
    results = small_results(["home"])
    empty = {name: frame.iloc[:0] for name, frame in results.experiments["home"].analyses["explorer"].items()}
    assert shown(**empty) == []
