"""MRR* by kind of query in the report, against values by hand for a few groups."""

from dataclasses import replace
from typing import Any

import pandas as pd
import pytest

from isi.report.sections import queries, run
from tests.reports import small_results

COLUMNS = [
    "model",
    "size",
    "seed",
    "scope",
    "filter",
    "relation",
    "hidden",
    "novel",
    "queries",
    "mrr_star",
]


def groups(*rows: tuple[Any, ...]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=COLUMNS).assign(observations=1)


def about(model: str, seed: int, given: float, answer: float) -> list[tuple[Any, ...]]:
    """Rows of scope novel: two groups that count, and two groups that must be ignored."""
    cell = (model, 1, seed, "novel", "learned", "on")
    return [
        (*cell, "tail", "given", 2, given),
        (*cell, "head", "answer", 1, answer),
        (*cell, "tail", "both", 9, 0.99),
        (*cell, "relation", "given", 3, 0.98),
    ]


ROWS = groups(
    *about("es", 0, 0.5, 0.1),
    *about("es", 1, 0.7, 0.3),
    *about("xavier", 0, 0.1, 0.4),
    *about("xavier", 1, 0.1, 0.4),
    *about("joint", 0, 0.9, 0.8),
    *about("joint", 1, 0.9, 0.8),
)
MODELS = ["xavier", "es", "joint"]


def test_each_direction_has_its_leader_and_the_rows_of_its_table() -> None:
    home = replace(
        small_results(["home"]).experiments["home"], initializers=MODELS[:-1], queries=ROWS
    )
    found = home.directions
    means = {
        name: {model: estimate.mean for model, estimate in of_model.items()}
        for name, of_model in found.items()
    }
    assert means["given"] == pytest.approx({"xavier": 10, "es": 60, "joint": 90})
    assert means["answer"] == pytest.approx({"xavier": 40, "es": 20, "joint": 80})
    assert queries.leader(found["given"]) == (
        "es",
        pytest.approx(60),
        pytest.approx({"xavier": 10, "es": 60}),
    )
    assert queries.leader(found["answer"]) == (
        "xavier",
        pytest.approx(40),
        pytest.approx({"xavier": 40, "es": 20}),
    )
    es = found["given"]["es"]
    assert es.low < es.mean < es.high
    other = ROWS.assign(filter="true", mrr_star=0.0)
    assert replace(home, queries=pd.concat([ROWS, other])).given_means["es"].mean == pytest.approx(
        60
    )


def test_relations_stand_by_direction_and_scope_novel_by_where_the_novel_entity_is() -> None:
    cell = ("joint", 1, 0, "all", "learned")
    everything = groups(
        (*cell, "on", "head", "none", 3, 0.2),
        (*cell, "on", "head", "given", 1, 0.6),
        (*cell, "in", "tail", "none", 2, 0.8),
        (*cell, "in", "relation", "none", 2, 0.1),
    )
    frame = queries.by_relation(pd.concat([ROWS, everything]))
    assert frame[["scope", "query", "novel entity", "queries"]].to_numpy().tolist() == [
        ["novel", "(?, on, t)", "answer", 2],
        ["novel", "(h, on, ?)", "given", 4],
        ["novel", "(h, on, ?)", "both", 18],
        ["all", "(h, in, ?)", "any or none", 2],
        ["all", "(?, on, t)", "any or none", 4],
    ]
    assert frame["joint"].tolist() == pytest.approx([80, 90, 99, 80, 30])
    assert frame["es"].tolist()[:2] == pytest.approx([20, 60])


def test_filters_stand_side_by_side() -> None:
    rows = groups(
        *(
            ("es", 1, seed, scope, which, "on", hidden, "none", 1, value + seed / 10)
            for scope in ("all", "novel")
            for which, hidden, value in (
                ("learned", "head", 0.2),
                ("learned", "relation", 0.6),
                ("true", "head", 0.4),
                ("true", "relation", 0.8),
            )
            for seed in (0, 1)
        )
    )
    means = queries.filters(rows).loc["all", "es"]
    assert means["mrr_star"].to_dict() == pytest.approx({"learned": 45, "true": 65})
    assert means["mrr_star_entity"].to_dict() == pytest.approx({"learned": 25, "true": 45})
    assert means["mrr_star_relation"].to_dict() == pytest.approx({"learned": 65, "true": 85})


def test_coordinates_in_use_are_those_of_any_relation() -> None:
    used = pd.DataFrame(
        [
            (seed, relation, part, number, 50 if part == "scalars" else 25)
            for seed in (0, 1)
            for relation, part, number in (
                ("on", "scalars", 4),
                (None, "scalars", 5 + seed),
                ("on", "blocks", 3),
                (None, "blocks", 10),
            )
        ],
        columns=["seed", "relation", "part", "used", "of"],
    )
    assert run.in_use(used) == pytest.approx({"scalars in use %": 11, "blocks in use %": 40})
