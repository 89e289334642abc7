"""Tables of graphs that grow: a chain by hand, and the files that git keeps."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
import yaml

from isi.report.tables.data import Models
from isi.report.tables.growing import PUBLISHED, RUN, GrownRuns
from isi.report.tables.registry import frames_of

ROOT = Path(__file__).parent.parent
TABLES = ROOT / "reports/continual/tables"
LABELS = {"xavier": "Xavier", "fold_in": "Fold-in", "mean": "Mean", "er_avg": "ERAvg"}
KEYS = ["phase", "protocol", "i", "j", "slot", "answer", "queries", "mrr"]
DIAL = {"share": 0.3}
#: After snapshot 0 the base test, then each test set under two protocols; MRR rises with the seed.
FIRST = [("trained", protocol, 0, 0, "head", "old", 4, 0.5) for protocol in ("current", "incde")]
LATER = [
    ("inserted", "current", 1, 1, "head", "new", 1, 0.25),
    ("inserted", "current", 1, 1, "tail", "old", 3, 0.5),
    ("trained", "current", 1, 0, "head", "old", 2, 0.25),
    ("trained", "current", 1, 0, "tail", "old", 6, 0.5),
    ("trained", "old", 1, 0, "head", "old", 2, 0.5),
    ("trained", "old", 1, 0, "tail", "old", 6, 0.75),
    ("trained", "current", 1, 1, "head", "new", 1, 0.75),
    ("trained", "current", 1, 1, "tail", "new", 1, 0.25),
    ("trained", "current", 1, 1, "tail", "old", 2, 0.5),
    ("trained", "incde", 1, 0, "head", "old", 8, 0.5),
    ("trained", "incde", 1, 1, "head", "new", 2, 0.25),
]


def grown(timeline: str = "ENTITY", **initializers: Any) -> GrownRuns:
    """Chains of two seeds; the second has values lower by a tenth."""
    settings = SimpleNamespace(
        title="Own",
        timeline=timeline,
        model="complex",
        dimension=4,
        initializers=initializers,
        strategies_of=lambda key: ["insert", "finetune"] if key == "xavier" else ["insert"],
        initializer_of=lambda key: ("fold_in", DIAL) if key == "fold_in_0_3" else (key, {}),
        strategy_of=lambda key: (key, {}),
    )
    first, later = (pd.DataFrame(rows, columns=KEYS) for rows in (FIRST, LATER))
    chains = [(name, of) for name in initializers for of in settings.strategies_of(name)]
    parts = [first.assign(initializer=None, strategy=None)]
    for place, (name, of) in enumerate(chains):
        lower = later["mrr"] / (1 + place)
        parts.append(later.assign(initializer=name, strategy=of, mrr=lower))
    frame = pd.concat(parts)
    matrix = pd.concat([frame.assign(seed=0), frame.assign(seed=1, mrr=0.9 * frame["mrr"])])
    square = matrix["mrr"] ** 2  # where all rows of a test set have an equal MRR, no spread
    matrix = matrix.assign(**{"hits@1": 0.5, "hits@10": 1.0, "mrr_square": square})
    costs = matrix.dropna()[RUN].drop_duplicates().assign(seconds=3)
    faults = [{"fault": fault, "test": 0, "share": 0.5} for fault in PUBLISHED["faults"]]
    models = Models(LABELS, {})
    return GrownRuns("own", settings, models, matrix, costs, pd.DataFrame(faults))


def test_a_chain_has_the_measures_by_hand() -> None:
    (row,) = grown(mean={}).measures.to_dict("records")
    both = 0.95  # the mean of both seeds, by that of the first
    by_hand = {
        "new tests, at once": 100 * both * (0.25 + 3 * 0.5) / 4,
        "new tests, after training": 100 * both * (0.75 + 0.25 + 2 * 0.5) / 4,
        "base test, before": 100 * both * 0.5,
        "base test, in the end": 100 * both * (2 * 0.25 + 6 * 0.5) / 8,
        "D": 100 * both * ((0.5 + 0.75) / 2 - (0.25 + 0.5) / 2),
        "seconds": 3,
    }
    assert {name: row[name] for name in by_hand} == pytest.approx(by_hand)
    assert row["D high"] - row["D"] == pytest.approx(12.706 * 100 * 0.25 * 0.05, rel=1e-3)


def test_intervals_include_the_sample_of_test_triples() -> None:
    runs = grown(mean={})
    matrix = runs.matrix.assign(mrr_square=runs.matrix["mrr"] ** 2)
    base = (matrix["j"] == 0) & (matrix["i"] == 0)
    matrix.loc[base, "mrr_square"] += 0.04  # a variance of 4 queries, thus of 2 triples
    (row,) = replace(runs, matrix=matrix).measures.to_dict("records")
    seeds = 12.706 * 100 * 0.5 * 0.05
    by_hand = (seeds**2 + (196 * (0.04 / 2) ** 0.5) ** 2) ** 0.5
    assert row["base test, before high"] - row["base test, before"] == pytest.approx(by_hand, 1e-3)


def test_the_default_stands_beside_simple_initializers() -> None:
    runs = grown(default={}, xavier={}, er_avg={}, fold_in_0_3=DIAL)
    made = frames_of("continual", [runs])
    (row,) = made["carried"].to_dict("records")
    measures = runs.measures
    for title, name in {"default": "default", "ERAvg": "er_avg"}.items():
        of_chain = measures.loc[(name, "insert"), "new tests, at once"]
        assert row[f"new tests: {title}"] == of_chain
    all_rows = measures.loc[("xavier", "finetune"), "base test, in the end"]
    assert row["base test: Xavier, all rows trained"] == all_rows
    assert made["frontier"]["line"].tolist() == ["default", "ERAvg", "Fold-in, share"]
    assert made["frontier"]["value"].tolist()[2] == 0.3
    assert not {"carried", "frontier"} & set(frames_of("continual", [grown(xavier={})]))


def test_tables_have_the_columns_that_git_keeps() -> None:
    made = frames_of("continual", [grown(default={}, xavier={}, fold_in_0_3=DIAL)])
    assert list(made["matrices"]) == [
        *("experiment", "benchmark", "initializer", "strategy", "i", "j", "MRR")
    ]
    r = made["matrices"].set_index(["initializer", "strategy", "i", "j"])["MRR"]
    assert r["default", "inserted alone", 1, 0] == pytest.approx(95 * 0.4375)
    assert len(r) == 4 * 3
    kept = {"grown_own": "grown_fbinc_s"}
    for name in ("grown_own", "after_last", "interference"):
        header = pd.read_csv(TABLES / f"{kept.get(name, name)}.csv", nrows=0)
        assert list(made[name]) == list(header), name
    assert made["grown_own"]["initializer"].tolist()[-1] == "Fold-in, share 0.3"
    assert list(made["faults"]) == ["benchmark", "fault", "test 0"]
    faults = pd.read_csv(TABLES / "faults.csv")["fault"].unique()
    assert made["faults"]["fault"].tolist() == faults.tolist()


def test_published_numbers_stand_beside_ours_with_protocol_and_model() -> None:
    made = frames_of("continual", [grown(xavier={})])
    for name in ("after_last", "interference"):
        kept = pd.read_csv(TABLES / f"{name}.csv")
        kept = kept[(kept["benchmark"] == "ENTITY") & (kept["source"] != "this run")]
        rows = made[name]
        theirs = rows[rows["source"] != "this run"].drop(columns="benchmark").round(2)
        expected = kept.drop(columns="benchmark")
        pd.testing.assert_frame_equal(theirs.reset_index(drop=True), expected, check_dtype=False)
        ours = rows[rows["source"] == "this run"]
        assert ours["method"].tolist() == ["Xavier, inserted alone", "Xavier, all rows"]
        assert set(ours["model"]) == {"complex, d = 4"}
    nobody = frames_of("continual", [grown(timeline="own", xavier={})])
    assert not {"after_last", "interference"} & set(nobody)


def test_every_strategy_of_the_pipeline_has_a_name() -> None:
    params = yaml.safe_load((ROOT / "continual/params.yaml").read_text("utf-8"))["continual"]
    strategies = [pair for entry in params.values() for pair in entry["strategies"].items()]
    listed = {options.get("strategy", name) for name, options in strategies}
    assert listed <= set(PUBLISHED["strategies"])
