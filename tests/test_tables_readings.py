"""Tables of the paper's results under every reading: small cases by hand."""

from math import inf, nan, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.stats import t as student

from isi.evaluation import readings as evaluation
from isi.report.tables import readings as tables
from isi.report.tables.data import Models
from isi.report.tables.readings import READINGS, CaseRuns, Measured, PaperResult, Readings
from isi.report.tables.registry import frames_of

ROOT = Path(__file__).parent.parent
FIVE = {"xavier": "Xavier", "iu": "IU", "es": "ES", "rs": "RS", "ers": "ERS"}
ROLES = dict.fromkeys(FIVE, "isi") | {"xavier": "baseline", "iu": "baseline"}
MODELS = Models(FIVE | {"mean": "Mean", "joint": "Joint"}, ROLES, {})
PAPER = yaml.safe_load((ROOT / "data/raw/paper/values.yaml").read_text("utf-8"))


def case_of(**changed: Any) -> Any:
    sessions = SimpleNamespace(seeds=2, sizes=changed.pop("sizes", [2, 3]))
    usual = {"initializers": [*FIVE], "finetuned": [2, 3], "indicators": {}, "changes": {}}
    return SimpleNamespace(sessions=sessions, **usual | changed)


def frame_of(rows: dict[tuple[str, int, int], Any]) -> pd.DataFrame:
    """Values by seed of (model, k, size), equal under every reading or an array of both."""
    parts = {
        key: pd.DataFrame(np.broadcast_to(np.array(of).reshape(2, -1), (2, len(READINGS))))
        for key, of in rows.items()
    }
    frame = pd.concat(parts, names=["model", "k", "size", "seed"])
    return frame.set_axis(READINGS, axis=1).sort_index()


def test_readings_have_the_order_of_the_pipeline() -> None:
    assert [reading.name for reading in evaluation.readings()] == READINGS
    assert evaluation.Reading().name == tables.OURS


def test_results_are_those_by_hand() -> None:
    mrr_star = {
        ("xavier", 0, 2): [40.0, 60.0],
        ("es", 0, 2): [60.0, 80.0],
        ("joint", 0, 2): [80.0, 80.0],
        ("xavier", 0, 3): [20.0, 60.0],
        ("es", 0, 3): [40.0, 60.0],
        ("joint", 0, 3): [80.0, nan],
        ("es", 1, 2): [50.0, 70.0],
        ("es", 4, 2): [75.0, 75.0],
        ("es", 8, 2): [74.9, 75.0],
    }
    epochs = {
        ("es", 0, 2): [0.0, 10.0],
        ("es", 0, 3): [30.0, 40.0],
        ("xavier", 0, 2): [5.0, inf],
        ("xavier", 0, 3): [1.0, 1.0],
    }
    runs = CaseRuns(case_of(indicators={"es": [1, 4, 8]}), frame_of(mrr_star), frame_of(epochs))
    of = Measured(runs, READINGS[:3], 30)
    by_hand = {
        ("gain", "es"): (40 + 25) / 2,  # 70 / 50 and 50 / 40
        ("mrr_star", "xavier"): 45,
        ("drop", "xavier"): 100 * (1 - 45 / 80),
        ("epochs", "es"): 20,
        ("deviation", "es"): np.std([0, 10, 30, 40], ddof=1),
        ("best_indicators", "es"): 4,
        ("epochs", "xavier"): nan,  # undecided
    }
    for (measure, model), value in by_hand.items():
        found = getattr(of, measure)(model)[0]
        assert found == pytest.approx(np.full(3, value), nan_ok=True), measure
    # of two seeds, only a difference of zero is sure; 1 is 15 below the best with an error of 10
    assert of.best_indicators("es")[1:, 0].tolist() == [1, 8]
    assert tables.means_of(runs.epochs, READINGS[0])["mean"].to_dict() == pytest.approx(
        {"es": 20, "xavier": nan}, nan_ok=True
    )


def results_with(cases: dict[str, CaseRuns], *listed: PaperResult) -> Readings:
    made = Readings(PAPER, MODELS, 0.001, cases)
    made.__dict__["results"] = list(listed)  # in place of the cached property
    return made


def test_an_interval_is_that_of_a_mean_over_the_papers_repeats() -> None:
    values = np.full((2, len(READINGS)), [[60.0], [80.0]])
    about_new = READINGS.index("test novel relation halves learned all")
    values[:, about_new] = [60.0, 90.0]
    values[:, READINGS.index(tables.OURS)] = nan
    runs = CaseRuns(case_of(sizes=[2]), frame_of({("es", 0, 2): values}), pd.DataFrame())
    results = [
        PaperResult("", "", "es", paper, "published", "mrr_star", about, ordered=False)
        for paper, about in ((75.0, ""), (320.0, ""), (75.0, "novel"))
    ]
    made = results_with({"published": runs}, *results)
    half = student.ppf(0.975, 1) * 10 * sqrt(1 + 2 / PAPER["settings"]["repeats"])
    assert made.values[0, :, 0] == pytest.approx([70, 70 - half, 70 + half])
    assert made.distance[:2, 0] == pytest.approx([5 / half, 250 / half])
    # without a value a reading is far, unless the paper says whom the queries are about
    assert made.distance[:, READINGS.index(tables.OURS)].tolist() == [tables.FAR, tables.FAR, 0]
    assert made.ranked.index[0] == READINGS[about_new]
    assert made.chosen != READINGS[about_new]  # which the paper's words do not allow
    assert tables.allowed(made.chosen)


def test_measures_are_read_by_reading_and_undecided_epochs_are_infinite() -> None:
    columns = ["queries", "about", "weights", "slots", "filter", "truth"]
    names = pd.DataFrame([reading.split() for reading in READINGS], columns=columns)
    rows = names.assign(mrr_star=np.arange(len(READINGS)) / 1000, epochs=nan, k=0, size=2)
    frame = pd.concat([rows.assign(model=model, seed=0) for model in ("es", "joint")])
    runs = CaseRuns.of(case_of(sizes=[2]), frame.sample(frac=1, random_state=0))
    assert runs.mrr_star.loc["es"].iloc[0].tolist() == pytest.approx(np.arange(len(READINGS)) / 10)
    assert runs.epochs.index.unique("model").tolist() == ["es"]
    assert np.isinf(runs.epochs).all(axis=None)


def small_cases() -> dict[str, CaseRuns]:
    """Random numbers of every case."""
    rng, cases = np.random.default_rng(0), dict[str, CaseRuns]()
    for name in sorted({*tables.STEPS["published"], *tables.STEPS["extended"], "decay", "sweep"}):
        numbers = {"indicators": {of: [1, 4] for of in ("es", "rs", "ers")}}
        control = [] if name in ("decay", "extended") else ["mean"]
        changes = {"finetuning.weight_decay": 0.1} if name == "decay" else {}
        case = case_of(initializers=[*FIVE, *control], changes=changes, **numbers)
        keys = [(model, k, size) for model in FIVE for k in (0, 1, 4) for size in (2, 3)]
        keys += [(model, 0, size) for model in (*control, "joint") for size in (2, 3)]
        of_mrr = {key: rng.uniform(20, 90, (2, len(READINGS))) for key in keys}
        of_epochs = {
            key: rng.integers(0, 9, (2, len(READINGS))).astype(float)
            for key in keys
            if key[0] != "joint"
        }
        cases[name] = CaseRuns(case, frame_of(of_mrr), frame_of(of_epochs))
    return cases


def test_tables_have_the_columns_and_rows_that_git_keeps() -> None:
    made = frames_of("readings", Readings(PAPER, MODELS, 0.001, small_cases()))
    folder = ROOT / "reports/readings/tables"
    assert set(made) == {path.stem for path in folder.glob("*.csv")}
    for name, frame in made.items():
        kept = pd.read_csv(folder / f"{name}.csv")
        assert list(frame) == list(kept), name
        if "rank" not in kept:  # their rows depend on the numbers
            assert frame.iloc[:, 0].tolist() == kept.iloc[:, 0].tolist(), name
    titles = pd.read_csv(folder / "paper_results.csv")
    assert made["paper_results"][["what", "paper"]].equals(titles[["what", "paper"]])


def test_without_the_papers_own_graph_there_is_no_table() -> None:
    assert frames_of("readings", Readings(PAPER, MODELS, 0.001, {})) == {}
