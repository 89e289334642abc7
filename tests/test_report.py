"""The report's numbers, worked out by hand on a handful of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex

from isi import params
from isi.report import approach, cross_validation, figures, page, rates, sensitivity, tables
from isi.report.results import Results

ROOT = Path(__file__).parent.parent
EMPTY = pd.DataFrame()
PAPER = {
    "indicators": {"es": 8, "rs": 18, "ers": 9},
    "training": {"dimension": 100, "ratio": 9, "learning_rate": 0.2, "weight_decay": 0.001},
}


def results(rows: list[tuple[str, str, int, int, int, float]], **others: Any) -> Results:
    """Results of runs (model, scope, size, seed, epoch, MRR*), four queries each, and of other studies."""
    columns = ["model", "scope", "size", "seed", "epoch", "mrr_star"]
    runs = pd.DataFrame(rows, columns=columns).assign(queries=4)
    empty = dict.fromkeys(
        ("definitions", "observations", "entities", "triples", "coverage", "splits", "novel", "insert_triples",
         "theta0_log", "joint_log", "inserted", "ties", "sweep", "rates", "cross_validation", "affordances",
         "transfer", "mined"), EMPTY,
    )  # fmt: skip
    given = {"params": params.load(ROOT / "params.yaml"), "paper": PAPER, "runs": runs, "approach": {}}
    return Results(**(empty | given | others))


def test_improvement_is_the_ratio_of_means_at_each_size_averaged_over_sizes() -> None:
    made = results(
        [
            ("xavier", "all", 1, 0, 0, 0.2), ("xavier", "all", 1, 1, 0, 0.6), ("xavier", "all", 2, 0, 0, 0.5),
            ("es", "all", 1, 0, 0, 0.6), ("es", "all", 1, 1, 0, 0.6), ("es", "all", 2, 0, 0, 0.5),
            ("es", "all", 2, 0, 1, 0.9),
        ]
    )  # fmt: skip
    # size 1: 0.6 / 0.4 = 1.5; size 2: 0.5 / 0.5 = 1: a quarter on average (the ratio of all means is another)
    assert tables.improvement_over_xavier(made, "all")["es"] == pytest.approx(25)


def test_the_interval_is_students() -> None:
    values, by = pd.Series([1.0, 2.0, 3.0, np.nan, 5.0, 4.0, 4.0]), pd.Series([7, 7, 7, 7, 8, 9, 9])
    found = figures.intervals(values, by)
    mean, low, high = found.loc[7]
    assert mean == 2
    assert (low, high) == pytest.approx((2 - 4.302653 / 3**0.5, 2 + 4.302653 / 3**0.5))  # t of 2 degrees, 97.5 %
    assert found.loc[8].tolist() == [5, 5, 5]
    assert found.loc[9].tolist() == [4, 4, 4]


@pytest.mark.parametrize(
    ("text", "phrase", "named"),
    [
        ("a box that slides open", "open", True),
        ("an open-topped box", "open", True),
        ("an oven that heats food", "heat", True),
        ("used for cutting bread", "cut", True),
        ("slicing bread", "slice", True),
        ("a lamp on a desk", "desk", True),
        ("a lamp that is turned on by hand", "turn on", True),
        ("the kitchenette of a flat", "kitchen", False),
        ("something unbroken", "break", False),
        ("eaten at breakfast", "break", False),
    ],
)
def test_definitions_name_what_they_say_in_regular_inflections(text: str, phrase: str, named: bool) -> None:
    assert tables.names(text, phrase) is named


def test_numbers_are_shown_as_people_read_them() -> None:
    frame = pd.DataFrame({"whole": [1.0, np.nan, 1234.0], "part": [0.05, 1.25, 12.0], "text": ["a", "b", "c"]})
    shown = page.shorten(frame)
    assert shown["whole"].tolist() == ["1", "–", "1,234"]
    assert shown["part"].tolist() == ["0.1", "1.2", "12.0"]
    assert shown["text"].tolist() == ["a", "b", "c"]


def test_the_rule_picks_from_what_is_about_novel_entities() -> None:
    novel, epochs = {1: 0.60, 2: 0.62, 3: 0.62, 4: 0.55, 5: 0.70}, {1: 30, 2: 20, 3: 10, 4: 5, 5: 0}
    columns = ["model", "k", "scope", "size", "seed", "epoch", "mrr_star", "queries"]
    swept = pd.DataFrame(
        [
            row
            for model in ("es", "rs", "ers")
            for k in novel
            for row in (
                (model, k, "novel", 5, 0, 0, novel[k], 4),
                (model, k, "all", 5, 0, 0, 0.7, 4),
                (model, k, "novel_heldout", 5, 0, 0, 0.1, 4),
                (model, k, "novel_heldout", 5, 0, epochs[k], 0.7, 4),
            )
        ],
        columns=columns,
    )
    found = results([("joint", "all", 5, 0, 0, 0.7), ("joint", "novel_heldout", 5, 0, 0, 0.7)], sweep=swept)
    table = sensitivity.indicator_sizes(found).frame.set_index("initializer")
    # epochs fall on and on; of MRR* size 4 has 7 points less than the best before it
    assert table["picked by the rule"].to_dict() == {"ES": 3, "RS": 3, "ERS": 3}
    assert table["paper"].to_dict() == {"ES": 8, "RS": 18, "ERS": 9}
    assert table.loc["ES", ["picked: MRR*", "picked: epochs", "best MRR*", "best at"]].tolist() == [62, 10, 70, 5]


def test_cross_validation_marks_the_choices_and_gives_the_spread_over_folds() -> None:
    params_ = params.load(ROOT / "params.yaml")
    rows = [
        setting.model_dump() | {"fold": fold, "mrr_star": value, "mrr_star_entity": 0.5, "mrr_star_relation": 0.9,
                                "mrr": 0.4, "epoch": 20}
        for setting in params_.settings for fold, value in enumerate((0.6, 0.7))
    ]  # fmt: skip
    rows[0]["mrr_star"] = 0.4
    table = cross_validation.cross_validation(results([], cross_validation=pd.DataFrame(rows))).frame
    assert len(table) == 13
    ours, other = table.iloc[0], table[table["learning rate"] == "0.2"].iloc[0]
    assert (ours["choice of"], other["choice of"]) == ("this run", "paper")
    assert ours["MRR*"] == pytest.approx(55)
    assert ours["std"] == pytest.approx(100 * 0.3 / 2**0.5)
    assert other["MRR*"] == pytest.approx(65)


def test_the_order_at_other_rates_is_told_as_it_is() -> None:
    def run(model: str, factor: float, epoch: int) -> dict[str, Any]:
        cell = {"scope": "all", "size": 5, "seed": 0, "queries": 4}
        return {"model": model, "factor": factor, "epoch": epoch, "mrr_star": 0.7} | cell

    main = [("joint", "all", 5, 0, 0, 0.7), ("es", "all", 5, 0, 3, 0.7), ("rs", "all", 5, 0, 4, 0.7)]
    half = [run("es", 0.5, 6), run("rs", 0.5, 8)]
    same = results(main, rates=pd.DataFrame([*half, run("es", 2, 1), run("rs", 2, 2)]))
    assert "same at every rate, fewest epochs first: ES, RS." in rates.order_of_initializers(same, "all")
    tied = results(main, rates=pd.DataFrame([*half, run("es", 2, 1), run("rs", 2, 1)]))
    assert rates.order_of_initializers(tied, "all").endswith("ES, RS at ×0.5; ES, RS at ×1; ES = RS at ×2.")
    table = rates.convergence_by_rate(tied).frame.set_index("initializer")
    assert table.loc["RS", ["×0.5: mean", "×1: mean", "×2: mean"]].tolist() == [8, 4, 1]


def test_the_plane_is_that_of_the_covariances_first_eigenvectors() -> None:
    vectors = np.random.default_rng(0).normal(size=(30, 6)) * [1, 5, 1, 1, 3, 1] + 7
    centre, axes, share = approach.plane(vectors.astype(np.float32))
    values, eigenvectors = np.linalg.eigh(np.cov(vectors.T))
    assert np.allclose(centre, vectors.mean(0), atol=1e-5)
    assert np.allclose(np.abs(axes @ eigenvectors[:, :-3:-1]), np.eye(2), atol=1e-4)
    assert np.allclose(axes @ axes.T, np.eye(2), atol=1e-6)
    assert share == pytest.approx(values[-2:].sum() / values.sum(), abs=1e-4)
    assert (axes.max(1) == np.abs(axes).max(1)).all()


def test_without_a_followed_size_the_table_of_corruption_says_so() -> None:
    how = params.load(ROOT / "params.yaml")
    unfollowed = how.model_copy(update={"curves": how.curves.model_copy(update={"sizes": [99]})})
    table = tables.corruption(results([("es", "known", 5, 0, 0, 0.5)], params=unfollowed))
    assert table.frame.empty
    assert "no size in curves.sizes was inserted" in table.caption


def test_curves_have_bands_but_for_controls() -> None:
    rows = [(model, "all", 5, seed, epoch, 0.5 + 0.1 * seed)
            for model in ("es", "mean", "joint") for seed in (0, 1) for epoch in (0, 1)]  # fmt: skip
    canvas = figures.follow(results(rows), 5, ("all", "all"))
    bands = [to_hex(band.get_facecolor()[0]) for band in canvas.axes[0].collections]
    assert bands == [figures.COLOURS["es"]]
    assert len(canvas.axes[0].lines) == 3  # means of both, and the joint model's level


def test_a_long_legend_has_two_rows_that_are_read_one_after_the_other() -> None:
    models = [*params.load(ROOT / "params.yaml").insert.initializers, "joint"]
    made = results([(model, scope, 1, 0, 0, 0.5) for model in models for scope in ("all", "novel")])
    canvas = figures.immediate(made).canvas
    canvas.draw_without_rendering()
    places = {text.get_text(): text.get_window_extent() for text in canvas.legends[0].get_texts()}
    rows = sorted({round(place.y0) for place in places.values()}, reverse=True)
    assert len(rows) == 2
    read = sorted(places, key=lambda name: (rows.index(round(places[name].y0)), places[name].x0))
    assert read == [tables.label(model) for model in models]


@pytest.mark.parametrize(
    ("heights", "placed"),
    [
        ([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]),
        ([0.1, 0.12, 0.5], [0.1, 0.2, 0.5]),
        ([0.1, 0.1, 0.1], [0.1, 0.2, 0.3]),
        ([0.2, 0.95, 0.97], [0.2, 0.9, 1.0]),  # no higher than the top
        ([], []),
    ],
)
def test_names_lie_a_gap_apart_and_near_what_they_name(heights: list[float], placed: list[float]) -> None:
    assert approach.spread(np.array(heights), 0.1) == pytest.approx(placed)
