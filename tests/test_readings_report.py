"""The page of the paper's numbers: results of small cases by hand, and the page from any cases."""

from dataclasses import replace
from math import inf, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from isi.analyses.readings import ReadingCase
from isi.config import check
from isi.evaluation.readings import Reading, place_of, readings
from isi.report import paper_values
from isi.report import readings as fits
from isi.report.data import Results
from isi.report.page import Page
from isi.report.readings import CaseRuns, Fit, PaperResult, Weighted
from isi.report.sections import readings as section
from isi.tables import paths
from tests.beyond_entries import READING_CASE
from tests.reports import ROOT, small_params

NUMBER = len(readings())
EVERY = np.arange(NUMBER)
EVEN = np.full((1, 2), 1 / 2)
FIVE = ["xavier", "iu", "es", "rs", "ers"]


def case_of(**changed: Any) -> ReadingCase:
    return check(
        READING_CASE | {"indicators": {}, "initializers": FIVE, **changed}, ReadingCase, "", ""
    )


def runs_of(
    mrr_star: dict[Any, list[float]], epochs: dict[Any, list[float]], **changed: Any
) -> CaseRuns:
    """A case whose numbers, by seed, are equal under every reading."""
    spread = [
        {key: np.repeat(np.array(of)[:, None], NUMBER, 1) for key, of in part.items()}
        for part in (mrr_star, epochs)
    ]
    return CaseRuns(case_of(**changed), *spread, {})


def test_results_are_those_by_hand() -> None:
    runs = runs_of(
        {
            ("xavier", 0, 2): [40.0, 60.0],
            ("es", 0, 2): [60.0, 80.0],
            ("joint", 0, 2): [80.0, 80.0],
            ("xavier", 0, 3): [20.0, 60.0],
            ("es", 0, 3): [40.0, 60.0],
            ("joint", 0, 3): [80.0, nan],
            ("es", 1, 2): [50.0, 70.0],
            ("es", 4, 2): [75.0, 75.0],
        },
        {
            ("es", 0, 2): [0.0, 10.0],
            ("es", 0, 3): [30.0, 40.0],
            ("xavier", 0, 2): [5.0, inf],
            ("xavier", 0, 3): [1.0, 1.0],
        },
        indicators={"es": [1, 4]},
    )
    by_hand = {
        (fits.gain, "es"): (40 + 25) / 2,  # 70 / 50 and 50 / 40
        (fits.mrr_star, "xavier"): 45,
        (fits.drop, "xavier"): 100 * (1 - 45 / 80),
        (fits.epochs, "es"): 20,
        (fits.deviation, "es"): np.std([0, 10, 30, 40], ddof=1),
        (fits.best_indicators, "es"): 4,
        (fits.epochs, "xavier"): inf,
    }
    for (measure, model), value in by_hand.items():
        found = measure(Weighted(runs, EVERY, EVEN), model)[0]
        assert found == pytest.approx(np.full(NUMBER, value))
    not_finetuned = replace(runs, case=case_of(finetuned=[], curves=[]))
    assert np.isnan(fits.epochs(Weighted(not_finetuned, EVERY, EVEN), "es")).all()


def test_an_interval_is_that_of_a_mean_over_the_papers_repeats_and_says_how_far_the_paper_is() -> (
    None
):
    runs = runs_of(
        {("es", 0, 2): [60.0, 80.0]},
        {},
        sessions=READING_CASE["sessions"] | {"sizes": [2]},
        finetuned=[],
        curves=[],
    )
    near, far = (PaperResult("", "", value, "own", fits.mrr_star, "es") for value in (75.0, 120.0))
    fit = Fit.of([near, far], {"own": runs}, repeats=6)
    # resamples of two seeds reach both of them in more than 2.5 % of cases
    half = 10 * sqrt(1 + 2 / 6)
    assert fit.estimate(0, 0).parts == pytest.approx((70, 70 - half, 70 + half))
    assert fit.distance[:, 0] == pytest.approx([5 / half, 50 / half])
    assert fit.within[:, 0].tolist() == [True, False]


def test_a_reading_without_a_value_is_far_and_about_may_be_the_papers() -> None:
    values = np.full((2, NUMBER), 50.0)
    about_new = place_of(Reading.of("test novel relation halves learned all"))
    values[:, about_new] = 80
    values[:, place_of(fits.OURS)] = nan
    sessions = READING_CASE["sessions"] | {"sizes": [2]}
    runs = CaseRuns(
        case_of(sessions=sessions, finetuned=[], curves=[]), {("es", 0, 2): values}, {}, {}
    )
    listed = [
        PaperResult("", "", 80.0, "own", fits.mrr_star, "es", about) for about in ("", "novel")
    ]
    fit = Fit.of(listed, {"own": runs}, repeats=30)
    assert fit.distance[:, place_of(fits.OURS)].tolist() == [fits.FAR, 0]
    assert fit.order([0])[0] == about_new


def small_cases(left_out: list[str], **changed: Any) -> dict[str, CaseRuns]:
    """Random numbers of every case that the page knows."""
    rng, cases = np.random.default_rng(0), {}
    names = {*section.STEPS["published"], *section.STEPS["extended"], "decay", "sweep"} - {
        *left_out
    }
    for name in sorted(names):
        indicators = {method: [1, 4] for method in ("es", "rs", "ers")} if name == "sweep" else {}
        case = case_of(initializers=[*FIVE, "mean"], indicators=indicators, **changed)
        models = [(model, 0) for model in [*case.initializers, "joint"]]
        models += [(model, k) for model, numbers in indicators.items() for k in numbers]
        keys = [(*model, size) for model in models for size in case.sessions.sizes]
        mrr_star = {key: rng.uniform(20, 90, (2, NUMBER)) for key in keys}
        epochs = {
            key: rng.integers(0, 3, (2, NUMBER)).astype(float)
            for key in keys
            if key[2] in case.finetuned
        }
        curves = {
            f"{model}.size={size:02d}": rng.uniform(0, 1, (2, 3, NUMBER)).astype("float32")
            for model in case.initializers
            for size in case.curves
        }
        cases[name] = CaseRuns(case, mrr_star, epochs, curves)
    return cases


def write_page(folder: Path, readings: Any) -> None:
    """Write the page of readings, of which no other results are known."""
    results = Results(
        params=small_params(["home"]),
        run={},
        paper=paper_values.read(ROOT / paths.PAPER),
        vocabulary={},
        definitions=pd.DataFrame(),
        experiments={},
        observed={},
        mined={},
        readings=readings,
    )
    Page.of("readings").write(folder, results)


@pytest.mark.parametrize(
    ("left_out", "changed", "absent"),
    [
        ([], {}, set()),
        (
            ["sweep", "extended"],
            {"finetuned": [], "curves": []},
            {
                "figure2_readings",
                "figure4_readings",
                "transfer_readings",
                "figure3b_readings_published",
                "table2_readings_published",
            },
        ),
    ],
)
def test_any_cases_make_a_page(
    tmp_path: Path, left_out: list[str], changed: dict[str, Any], absent: set[str]
) -> None:
    write_page(tmp_path, small_cases(left_out, **changed))
    drawn = {path.stem for path in tmp_path.glob("[ft]*/*")}
    assert not absent & drawn
    assert {
        "figure3a_readings_published",
        "paper_results",
        "nearest_readings",
        "readings_published",
    } <= drawn
    text = (tmp_path / "index.html").read_text("utf-8")
    assert "metrics.json" not in text
    assert "@table" not in text
    counts = pd.read_csv(tmp_path / "tables/readings_within.csv")
    assert (counts["within"] <= counts["results"]).all()


def test_without_the_papers_own_graph_there_are_no_results(tmp_path: Path) -> None:
    write_page(tmp_path, small_cases(["published"]))
    assert not (tmp_path / "tables/paper_results.csv").exists()
