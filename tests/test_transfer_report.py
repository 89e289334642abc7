"""The report on the transfer and on the paper's numbers,
against values by hand for small tables.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from isi.graph.graph import MinedSource
from isi.report.sections import finetuning, run
from isi.report.sections.queries import AffordanceAnswers
from tests.reports import frame_of, runs, small_results

KINDS = ["object", "affordance", "affordance", "room", "object"]
ENTITIES = pd.DataFrame(
    {
        "entity": ["shelf", "open", "push", "kitchen", "fan"],
        "kind": KINDS,
        "source": ["home"] * 4 + ["shop"],
    }
)


def ranked(model: str, seed: int, order: list[int]) -> list[tuple[str, int, int, int, int]]:
    """Ranks of the answers about the fan (entity 4); ``order``: the answers from rank 1 on."""
    return [(model, seed, 4, answer, rank) for rank, answer in enumerate(order, 1)]


def answers(*rows: list[tuple[str, int, int, int, int]]) -> AffordanceAnswers:
    columns = ["model", "seed", "entity", "answer", "rank"]
    ranks = pd.DataFrame([row for part in rows for row in part], columns=columns)
    return AffordanceAnswers(ranks, ENTITIES, "hasAffordance", ["affordance"], "home")


def test_the_drop_is_what_new_candidates_cost_at_once() -> None:
    start = runs(
        [
            ("xavier", "known", 10, 0, 0, 0.5),
            ("xavier", "known", 10, 1, 0, 0.4),
            ("xavier", "known_closed", 10, 0, 0, 0.7),
            ("xavier", "known_closed", 10, 1, 0, 0.8),
            ("es", "known", 10, 0, 0, 0.75),
            ("es", "known_closed", 10, 0, 0, 0.75),
            ("joint", "known", 10, 0, 0, 0.1),
            ("joint", "known_closed", 10, 0, 0, 0.9),
        ]
    )
    found = {model: drop.mean for model, drop in finetuning.interference_percent(start).items()}
    assert found == pytest.approx({"es": 0, "xavier": 100 * (1 - 0.9 / 1.5)})
    assert finetuning.interference_percent(start[start["scope"] == "known"]) == {}


def test_the_drop_resamples_both_scopes_together() -> None:
    rows = [
        ("es", scope, 10, seed, 0, value * (0.5 if scope == "known" else 1))
        for scope in ("known", "known_closed")
        for seed, value in enumerate((0.4, 0.8))
    ]
    assert finetuning.interference_percent(runs(rows))["es"].parts == pytest.approx((50, 50, 50))


def test_what_was_mined_goes_on_to_what_was_inserted() -> None:
    seen = pd.DataFrame(
        [("fan", "kitchen", 4), ("shelf", "kitchen", 5), ("bin", "kitchen", 1)],
        columns=["head", "tail", "count"],
    ).assign(relation="atLocation")
    kinds = pd.DataFrame(
        {"entity": ["fan", "shelf", "bin", "kitchen"], "kind": ["object"] * 3 + ["room"]}
    )
    triples = pd.DataFrame(
        [("fan", "atLocation", "kitchen", "shop"), ("shelf", "hasAffordance", "open", "home")],
        columns=["head", "relation", "tail", "source"],
    )
    added = (ENTITIES, triples, MinedSource("shop", seen, kinds), "the home", 3, 10)
    table = frame_of(finetuning.mining_steps({"instances": 12}, *added))
    assert dict(table.itertuples(index=False, name=None)) == {
        "instances": 12,
        "of these, of objects that the home has not": 5,
        "kinds of such objects": 2,
        "of these, with at least 3 observations": 1,
        "drawn as candidates": 1,
        "unique triples of the candidates": 1,
        "inserted in a repeat": 10,
    }
    uncounted = finetuning.mining_steps({}, *added)
    assert uncounted[0][""] == "instances of objects that the home has not"


def test_answers_go_by_mean_rank_over_repeats_and_those_that_are_no_affordance_are_marked() -> None:
    found = answers(
        ranked("es", 0, [1, 0, 2, 3, 4]),
        ranked("es", 3, [2, 1, 4, 0, 3]),
        ranked("rs", 0, [3, 4, 2, 1, 0]),
    )
    # means: open 1.5, push 2, shelf 3, kitchen 4.5; the fan itself is of the other source and no
    # answer here
    kinds = {"open": "affordance", "push": "affordance", "shelf": "object", "kitchen": "room"}
    assert found.top("es", "fan") == list(kinds.items())
    assert found.top("rs", "fan")[0] == ("kitchen", "room")
    assert found.top("es", "stove") == []
    assert found.judged("es", ["fan"], {"fan": ["open"]}) == {
        "affordances": 2,
        "wrong": 2,
        "plausible": 1,
        "unlikely": 1,
    }
    assert found.judged("es", ["fan"], {}) == {"affordances": 2, "wrong": 2}
    rows = found.ranked(
        ["fan", "stove"], ["es"], {"fan": ["open"]}, {"theirs": {"stove": ["× shelf", "open"]}}
    )
    assert [row["entity"] for row in rows] == ["fan (n = 2)"] * 4 + ["stove (n = 0)"] * 4
    assert [row["ES"] for row in rows] == ["open", "? push", "× shelf", "× kitchen", *["–"] * 4]
    assert [row["paper: theirs"] for row in rows] == [*["–"] * 4, "× shelf", "open", "–", "–"]
    unjudged = found.ranked(["fan"], ["es"], {}, {})  # nobody judged the fan
    assert [row["ES"] for row in unjudged] == ["open", "push", "× shelf", "× kitchen"]


def test_shares_count_affordances_among_the_first_four_of_every_inserted_entity() -> None:
    found = answers(
        ranked("es", 0, [1, 0, 2, 3, 4]),
        ranked("es", 3, [0, 3, 4, 2, 1]),
        ranked("rs", 0, [1, 2, 4, 0, 3]),
    )
    assert found.shares == pytest.approx({"es": 100 * 3 / 8, "rs": 50})
    frame = frame_of(found.shares_table(["es", "rs", "iu"])).set_index("initializer")
    assert frame["top 4: affordances %"].dropna().to_dict() == pytest.approx({"ES": 37.5, "RS": 50})
    assert frame["first: affordance %"].dropna().to_dict() == {"ES": 50, "RS": 100}


def test_the_definition_of_either_end_may_leak_triples_of_any_source_and_each_counts_once() -> None:
    rows = [
        ("home", "shelf", "hasAffordance", "open", 3),
        ("shop", "fan", "atLocation", "kitchen", 2),
        ("shop", "fan", "hasAffordance", "push", 1),
    ]
    triples = pd.DataFrame(rows, columns=["source", "head", "relation", "tail", "count"])
    said = {
        "shelf": "a board that may be opened",
        "fan": "what cools the air of kitchens",
        "open": "to push a shelf",
    }
    named = ENTITIES.assign(phrase=ENTITIES["entity"])
    graphs = [(named[:4], triples[:1]), (named, triples)]
    table, number = run.leaks(graphs, said)
    leaked = (
        [*rows[0], "head", said["shelf"]],
        [*rows[0], "tail", said["open"]],
        [*rows[1], "head", said["fan"]],
    )
    assert (table.to_numpy().tolist(), number) == (list(leaked), 3)
    # a tail is looked up by its phrase
    called = named.assign(phrase=named["phrase"].replace("kitchen", "air"))
    assert run.leaks([(called, triples)], said)[0]["tail"].tolist() == ["open", "kitchen", "open"]
    called = named.assign(phrase=named["phrase"].replace("kitchen", "hall"))
    assert run.leaks([(called, triples)], said)[0]["tail"].tolist() == ["open", "open"]


def test_orphans_are_known_entities_whose_training_triples_all_go() -> None:
    entities = pd.DataFrame({"entity": ["a", "b", "c", "d"]})
    triples = pd.DataFrame([("a", "b"), ("b", "c"), ("c", "d")], columns=["head", "tail"])
    splits = pd.DataFrame(
        {"seed": [0, 0, 0, 1, 1, 1], "triple": [0, 1, 2] * 2, "split": ["train"] * 5 + ["valid"]}
    )
    novel = pd.DataFrame({"size": [1, 1], "seed": [0, 1], "entity": [1, 1]})
    # without b: a has none left; in the second cell nor have c and d, whose triple is not trained
    # on
    assert run.orphans(entities, triples, splits, novel) == 1 + 3


def test_fallbacks_and_ties_are_counted_by_experiment() -> None:
    inserted = pd.DataFrame(
        {"model": ["es", "es", "rs", "rs"], "fallback": ["rs", None, "centroid", "centroid"]}
    )
    ties = pd.DataFrame(
        {"model": ["es", "es", "joint"], "scope": ["all", "all", "novel"], "ties": [2, 3, 4]}
    )
    results = small_results(["home", "away"], studies=False)
    home = replace(results.experiments["home"], initializers=["es"], inserted=inserted, ties=ties)
    away = replace(results.experiments["away"], inserted=inserted.assign(fallback=np.nan))
    table = run.fallbacks({"home": home, "away": away})
    assert table.to_numpy().tolist() == [["home", "ES", "rs", 1], ["home", "RS", "centroid", 2]]
    assert frame_of(run.ties({"home": home})).to_numpy().tolist() == [
        ["home", "ES", 5, 0],
        ["home", "Joint", 0, 4],
    ]
