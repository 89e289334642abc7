"""What the report says of what is asked, against a handful of groups."""

from __future__ import annotations

import pandas as pd
import pytest

from isi.report import parts
from isi.report.sections import asked, graph

COLUMNS = ["model", "size", "seed", "scope", "filter", "relation", "hidden", "novel", "queries", "mrr_star"]


def groups(*rows: tuple[str, int, int, str, str, str, str, str, int, float]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=COLUMNS).assign(observations=1)


def about(
    model: str, seed: int, given: float, answer: float
) -> list[tuple[str, int, int, str, str, str, str, str, int, float]]:
    """Two groups of scope novel; what is at both ends takes no part."""
    cell = (model, 1, seed, "novel", "learned", "on")
    return [(*cell, "tail", "given", 2, given), (*cell, "head", "answer", 1, answer),
            (*cell, "tail", "both", 9, 0.99), (*cell, "relation", "given", 3, 0.98)]  # fmt: skip


ROWS = groups(
    *about("es", 0, 0.5, 0.1), *about("es", 1, 0.7, 0.3), *about("xavier", 0, 0.1, 0.4), *about("xavier", 1, 0.1, 0.4),
    *about("joint", 0, 0.9, 0.8), *about("joint", 1, 0.9, 0.8),
)  # fmt: skip
MODELS = ["xavier", "es", "joint"]


def test_each_direction_has_its_leader_and_the_headline_is_what_is_asked_about_it() -> None:
    cells = parts.directed(ROWS, ["model", "size", "seed"])
    text = asked.leaders(cells, MODELS)
    assert "Asked about the novel entity, ES leads with 60.0 (Xavier 10.0 and ES 60.0; the joint model 90.0)." in text
    assert "Where it is the answer, Xavier leads with 40.0 (Xavier 40.0 and ES 20.0; the joint model 80.0)." in text
    frame = asked.directions(cells, MODELS).frame.set_index("model")
    columns = ["asked about the novel entity", "the novel entity is the answer"]
    assert frame.loc["ES", columns].tolist() == pytest.approx([60, 20])
    assert frame.loc["Xavier", [f"{columns[0]}{end}" for end in (" low", " high")]].tolist() == pytest.approx([10, 10])
    assert frame.loc["ES", f"{columns[0]} low"] < 60 < frame.loc["ES", f"{columns[0]} high"]
    other = ROWS.assign(filter="true", mrr_star=0.0)
    assert asked.asked_about(pd.concat([ROWS, other]), MODELS) == pytest.approx({"xavier": 10, "es": 60, "joint": 90})


def test_relations_stand_by_direction_and_scope_novel_by_where_the_novel_entity_is() -> None:
    cell = ("joint", 1, 0, "all", "learned")
    everything = groups((*cell, "on", "head", "none", 3, 0.2), (*cell, "on", "head", "given", 1, 0.6),
                        (*cell, "in", "tail", "none", 2, 0.8), (*cell, "in", "relation", "none", 2, 0.1))  # fmt: skip
    pairs = asked.by_pair(pd.concat([ROWS, everything]))
    frame = asked.by_relation(pairs, MODELS).frame
    assert frame[["scope", "query", "novel entity", "queries"]].to_numpy().tolist() == [
        ["novel", "(?, on, t)", "answer", 2],
        ["novel", "(h, on, ?)", "given", 4],
        ["novel", "(h, on, ?)", "both", 18],
        ["all", "(h, in, ?)", "any or none", 2],
        ["all", "(?, on, t)", "any or none", 4],
    ]
    assert frame["Joint"].tolist() == pytest.approx([80, 90, 99, 80, 30])
    assert frame["ES"].tolist()[:2] == pytest.approx([20, 60])
    assert "from 30.0 for (?, on, t) to 80.0 for (h, in, ?)" in asked.extremes(pairs)


def test_filters_stand_side_by_side() -> None:
    rows = groups(*(
        ("es", 1, seed, scope, which, "on", hidden, "none", 1, value + seed / 10)
        for scope in ("all", "novel")
        for which, hidden, value in (("learned", "head", 0.2), ("learned", "relation", 0.6), ("true", "head", 0.4),
                                     ("true", "relation", 0.8)) for seed in (0, 1)
    ))  # fmt: skip
    immediate = asked.by_filter(rows)
    frame = asked.filters(immediate, ["es", "joint"]).frame.set_index(["scope", "model"])
    assert frame.loc[("all", "ES")].to_dict() == pytest.approx({
        "MRR*: scope's filter": 45, "MRR*: all true": 65,
        "entity half: scope's filter": 25, "entity half: all true": 45,
        "relation half: scope's filter": 65, "relation half: all true": 85,
    })  # fmt: skip
    assert frame.loc[("novel", "Joint")].isna().all()
    assert "ES 45.0 with the first, ES 65.0 with the second" in asked.what_the_filter_does(immediate, ["es", "joint"])


def test_coordinates_in_use_are_those_of_any_relation() -> None:
    used = pd.DataFrame(
        [(seed, relation, part, number, 50 if part == "scalars" else 25)
         for seed in (0, 1) for relation, part, number in (("on", "scalars", 4), (None, "scalars", 5 + seed),
                                                           ("on", "blocks", 3), (None, "blocks", 10))],
        columns=["seed", "relation", "part", "used", "of"],
    )  # fmt: skip
    assert graph.in_use(used) == pytest.approx({"scalars in use %": 11, "blocks in use %": 40})
