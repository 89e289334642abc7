"""Tables of graphs that grow: against other code, and against the files that git keeps."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.stats
import yaml

from isi.continual.experiment import ContinualExperiment
from isi.report.tables.data import Models
from isi.report.tables.forms import files
from isi.report.tables.growing import CHAIN, PUBLISHED, RUN, GrownRuns
from isi.report.tables.registry import frames_of
from tests.small_continual import ENTRY
from tools import verify

ROOT = Path(__file__).parent.parent
TABLES = ROOT / "reports/continual/tables"
LABELS = {"xavier": "Xavier", "fold_in": "Fold-in", "mean": "Mean", "er_avg": "ERAvg"}
DIAL = {"initializer": "fold_in", "share": 0.003}
#: Phase, protocol, snapshot and test set of the rows; the first two are of the first embedding.
SETS = [
    ("trained", "current", 0, 0),
    ("trained", "incde", 0, 0),
    ("inserted", "current", 1, 1),
    *(("trained", protocol, 1, j) for protocol in ("current", "incde", "old") for j in (0, 1)),
]


def grown(timeline: str = "ENTITY", **initializers: Any) -> GrownRuns:
    """Chains of two seeds with random measures."""
    entry: dict[str, Any] = {"title": "Own", "timeline": timeline, "initializers": initializers}
    entry["strategies"] = {"insert": {}, "finetune": {}}
    entry["pairs"] = {name: ["insert"] for name in initializers} | {"xavier": "all"}
    settings = ContinualExperiment.model_validate(ENTRY | entry)
    rows = [(*of, *end) for of, end in product(SETS, product(("head", "tail"), ("old", "new")))]
    frame = pd.DataFrame(rows, columns=["phase", "protocol", "i", "j", "slot", "answer"])
    parts = [frame[frame["i"] == 0].assign(initializer=None, strategy=None)]
    for name in initializers:
        for strategy in settings.strategies_of(name):
            parts.append(frame[frame["i"] > 0].assign(initializer=name, strategy=strategy))
    seeds = [part.assign(seed=seed) for seed in (0, 1) for part in parts]
    matrix = pd.concat(seeds, ignore_index=True)
    rng = np.random.default_rng(0)
    matrix["queries"] = rng.integers(1, 9, len(matrix))
    for measure in ("mrr", "hits@1", "hits@10"):
        matrix[measure] = rng.random(len(matrix))
    matrix = matrix.assign(mrr_square=matrix["mrr"] ** 2)
    costs = matrix.dropna()[RUN].drop_duplicates().assign(seconds=3)
    faults = [{"fault": fault, "test": 0, "share": 0.5} for fault in PUBLISHED["faults"]]
    return GrownRuns("own", settings, Models(LABELS, {}), matrix, costs, pd.DataFrame(faults))


def test_measures_are_those_of_other_code() -> None:
    runs = grown(mean={}, xavier={})
    rows, names = runs.rows, ("mrr", "hits@1", "hits@10")
    tables = {"grown": runs.measures, "after_last": runs.after_last("incde", names)}
    tables["interference"] = runs.interference("", ["H_old", "H_cur", "D", "A_TN"])
    for chain, (_, of_chain) in zip(runs.chains, rows.groupby(CHAIN, sort=False), strict=True):
        seeds = [of_seed for _, of_seed in of_chain.groupby("seed")]
        by_seed = pd.DataFrame([verify.measures_of(of_seed, "incde") for of_seed in seeds])
        for name, columns in verify.SHOWN.items():
            of_table = tables[name].loc[chain, columns]
            assert of_table.tolist() == pytest.approx(by_seed[columns].mean().tolist())
        row = tables["grown"].loc[chain]
        around = scipy.stats.t.ppf(0.975, 1) * by_seed["D"].sem()
        ends = row["D"] - row["D low"], row["D high"] - row["D"]
        assert ends == pytest.approx((around, around))
        assert row["seconds"] == 3


def test_intervals_include_the_sample_of_test_triples() -> None:
    runs = grown(mean={})
    matrix = runs.matrix.copy()
    first = (matrix["i"] == 0) & (matrix["protocol"] == "current")
    matrix.loc[first, "mrr"] = 0.5 - 0.05 * matrix["seed"]
    # a variance of 0.04 over 8 queries, thus 4 triples
    matrix.loc[first, "mrr_square"] = matrix["mrr"] ** 2 + 0.04
    matrix.loc[first, "queries"] = 2
    (row,) = replace(runs, matrix=matrix).measures.to_dict("records")
    seeds = 12.706 * 100 * 0.05 / 2
    by_hand = (seeds**2 + (196 * (0.04 / 4) ** 0.5) ** 2) ** 0.5
    assert row["base test, before high"] - row["base test, before"] == pytest.approx(by_hand, 1e-3)


def test_the_default_stands_beside_simple_initializers() -> None:
    runs = grown(default={}, xavier={}, er_avg={}, fold_in_0_003=DIAL)
    made = frames_of("continual", [runs])
    (row,) = made["carried"].to_dict("records")
    of_chain = runs.measures["new tests, at once"]
    assert row["new tests: default"] == of_chain["default", "insert"]
    assert row["new tests: ERAvg"] == of_chain["er_avg", "insert"]
    all_rows = runs.measures.loc[("xavier", "finetune"), "base test, in the end"]
    assert row["base test: Xavier, all rows trained"] == all_rows
    assert made["frontier"]["line"].tolist() == ["default", "ERAvg", "Fold-in, share"]
    assert made["frontier"]["value"].tolist()[2] == 0.003
    assert "0.003" in files(made["frontier"])["md"]
    assert made["grown_own"]["initializer"].tolist()[-1] == "Fold-in, share 0.003"
    assert not {"carried", "frontier"} & set(frames_of("continual", [grown(xavier={})]))
    assert frames_of("continual", []) == {}


def test_tables_have_the_columns_and_published_numbers_that_git_keeps() -> None:
    made = frames_of("continual", [grown(default={}, xavier={})])
    assert list(made["matrices"]) == ["experiment", "benchmark", *CHAIN, "i", "j", "MRR"]
    assert len(made["matrices"]) == 3 * 3
    header = pd.read_csv(TABLES / "grown_fbinc_s.csv", nrows=0)
    assert list(made["grown_own"]) == list(header)
    assert list(made["faults"]) == ["benchmark", "fault", "test 0"]
    faults = pd.read_csv(TABLES / "faults.csv")["fault"].unique()
    assert made["faults"]["fault"].tolist() == faults.tolist()
    for name in ("after_last", "interference"):
        kept = pd.read_csv(TABLES / f"{name}.csv")
        kept = kept[(kept["benchmark"] == "ENTITY") & (kept["source"] != "this run")]
        rows = made[name]
        assert list(rows) == list(kept)
        theirs = rows[rows["source"] != "this run"].drop(columns="benchmark").round(2)
        expected = kept.drop(columns="benchmark")
        pd.testing.assert_frame_equal(theirs.reset_index(drop=True), expected, check_dtype=False)
        ours = rows[rows["source"] == "this run"]
        assert ours["method"].tolist()[1:] == ["Xavier, inserted alone", "Xavier, all rows"]
        assert set(ours["model"]) == {"complex, d = 4"}
    nobody = frames_of("continual", [grown(timeline="own", xavier={})])
    assert not {"after_last", "interference"} & set(nobody)


def test_every_strategy_of_the_pipeline_has_a_name() -> None:
    params = yaml.safe_load((ROOT / "continual/params.yaml").read_text("utf-8"))["continual"]
    strategies = [pair for entry in params.values() for pair in entry["strategies"].items()]
    listed = {options.get("strategy", name) for name, options in strategies}
    assert listed <= set(PUBLISHED["strategies"])
