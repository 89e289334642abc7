"""The report's numbers, worked out by hand on a handful of runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isi import params
from isi.report import figures, page, tables
from isi.report.results import Results

ROOT = Path(__file__).parent.parent
EMPTY = pd.DataFrame()


def results(rows: list[tuple[str, str, int, int, int, float]]) -> Results:
    """Results of runs (model, scope, size, seed, epoch, MRR*), four queries each."""
    columns = ["model", "scope", "size", "seed", "epoch", "mrr_star"]
    runs = pd.DataFrame(rows, columns=columns).assign(queries=4)
    runs.loc[runs["mrr_star"].isna(), "queries"] = 0
    others = dict.fromkeys(
        ("definitions", "observations", "entities", "triples", "coverage", "splits", "novel", "insert_triples",
         "theta0_log", "joint_log", "inserted", "ties"), EMPTY,
    )  # fmt: skip
    return Results(params=params.load(ROOT / "params.yaml"), paper={}, runs=runs, **others)


def test_convergence_is_the_first_epoch_within_the_margin_of_the_joint_model_of_the_same_seed() -> None:
    found = results(
        [
            ("joint", "all", 1, 0, 0, 0.70),
            ("joint", "all", 1, 1, 0, 0.90),
            ("es", "all", 1, 0, 0, 0.60), ("es", "all", 1, 0, 1, 0.63), ("es", "all", 1, 0, 2, 0.61),
            ("es", "all", 1, 1, 0, 0.63), ("es", "all", 1, 1, 1, 0.81),
        ]
    ).convergence.set_index("seed")  # fmt: skip
    assert found["epochs"].to_dict() == {0: 1, 1: 150}
    assert found["converged"].to_dict() == {0: True, 1: False}


def test_cells_without_queries_take_no_part_in_convergence() -> None:
    found = results(
        [
            ("joint", "novel_heldout", 1, 0, 0, np.nan),
            ("joint", "novel_heldout", 1, 1, 0, 0.5),
            ("es", "novel_heldout", 1, 0, 0, np.nan),
            ("es", "novel_heldout", 1, 1, 0, 0.5),
        ]
    ).convergence
    assert found["seed"].tolist() == [1]


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
    mean, low, high = figures.interval(pd.Series([1.0, 2.0, 3.0, np.nan]))
    assert mean == 2
    assert (low, high) == pytest.approx((2 - 4.302653 / 3**0.5, 2 + 4.302653 / 3**0.5))  # t of 2 degrees, 97.5 %
    assert figures.interval(pd.Series([5.0])) == (5, 5, 5)


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
