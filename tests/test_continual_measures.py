"""Published measures of continual embeddings, each computed by hand on small R."""

import numpy as np
import pandas as pd
import pytest

from isi.continual import continual_measures
from isi.continual.measures import (
    backward_transfer,
    forward_transfer,
    historical,
    mean_after_last,
    new_answers,
    omega_base,
    omega_new,
    relative_forgetting,
    score_matrix,
    sizes_of_tests,
)

NAN = np.nan
R = np.array([[0.5, NAN, NAN], [0.4, 0.6, NAN], [0.2, 0.7, 0.8]])
SIZES = np.array([10, 30, 60])


def test_mean_after_the_last_snapshot() -> None:
    assert mean_after_last(R) == pytest.approx((0.2 + 0.7 + 0.8) / 3)
    assert mean_after_last(R, SIZES) == pytest.approx((2 + 21 + 48) / 100)


def test_forward_transfer_is_the_mean_right_after_insertion() -> None:
    inserted = np.array([[NAN] * 3, [NAN, 0.1, NAN], [NAN, NAN, 0.3]])
    assert forward_transfer(inserted) == pytest.approx((0.1 + 0.3) / 2)


def test_backward_transfer_compares_the_last_row_with_the_diagonal() -> None:
    assert backward_transfer(R) == pytest.approx(((0.2 - 0.5) + (0.7 - 0.6)) / 2)


def test_omega_new_and_base() -> None:
    assert omega_new(R) == pytest.approx((0.6 + 0.8) / 2)
    assert omega_base(R) == pytest.approx((0.4 / 0.5 + 0.2 / 0.5) / 2)
    better = np.array([[0.5, NAN], [0.9, 0.6]])
    assert omega_base(better) == 1


def test_relative_forgetting_weighs_by_size_and_age() -> None:
    first = (0.2 - 0.5) / 0.5 * 0.1 / 2
    second = (0.7 - 0.6) / 0.6 * 0.3 / 1
    assert relative_forgetting(R, SIZES) == pytest.approx(first + second)


def test_no_measure_of_one_snapshot_or_of_hits_at_zero() -> None:
    single = np.array([[0.5]])
    assert np.isnan([backward_transfer(single), omega_new(single), omega_base(single)]).all()
    assert np.isnan(omega_base(np.array([[0.0, NAN], [0.5, 0.5]])))


def row(protocol: str, i: int, j: int, slot: str, answer: str, queries: int, mrr: float) -> dict:
    hits = {"hits@1": mrr / 2, "hits@3": mrr, "hits@10": 2 * mrr}
    values = {"phase": "trained", "protocol": protocol, "i": i, "j": j, "slot": slot}
    return values | {"answer": answer, "queries": queries, "mrr": mrr, **hits}


FRAME = pd.DataFrame(
    [
        row("current", 0, 0, "head", "new", 2, 0.9),
        row("current", 1, 0, "head", "old", 2, 0.5),
        row("current", 1, 0, "tail", "old", 2, 0.3),
        row("current", 1, 1, "head", "old", 1, 0.8),
        row("current", 1, 1, "tail", "new", 1, 0.2),
        row("current", 2, 0, "head", "old", 2, 0.1),
        row("current", 2, 1, "head", "old", 6, 0.5),
        row("current", 2, 2, "head", "new", 3, 0.6),
        row("old", 1, 0, "head", "old", 2, 0.6),
        row("old", 1, 0, "tail", "old", 2, 0.4),
        row("old", 2, 0, "head", "old", 2, 0.2),
        row("old", 2, 1, "head", "old", 6, 0.6),
    ]
)


def test_historical_queries_weigh_updates_and_slots_equally() -> None:
    # (update 1, head), (1, tail), (2, head: 2 and 6 queries of two test sets)
    h_cur = (0.5 + 0.3 + (2 * 0.1 + 6 * 0.5) / 8) / 3
    h_old = (0.6 + 0.4 + (2 * 0.2 + 6 * 0.6) / 8) / 3
    assert historical(FRAME, "current") == pytest.approx(h_cur)
    assert historical(FRAME, "old") == pytest.approx(h_old)
    table = continual_measures(FRAME).set_index("measure")["value"]
    assert table["D trained"] == pytest.approx(h_old - h_cur)


def test_new_answers_are_those_of_the_snapshot_of_an_update() -> None:
    assert new_answers(FRAME) == pytest.approx((0.2 + 0.6) / 2)
    assert np.isnan(new_answers(FRAME, "inserted"))


def test_r_pools_slots_and_answers_by_queries() -> None:
    r = score_matrix(FRAME, "current")
    assert r[1, 0] == pytest.approx(0.4)
    assert r[1, 1] == pytest.approx(0.5)
    assert np.isnan(r[0, 1:]).all()
    assert sizes_of_tests(FRAME).tolist() == [4, 6, 3]


def test_the_table_has_each_measure_by_protocol() -> None:
    table = continual_measures(FRAME)
    current = table[table["protocol"] == "current"].set_index("measure")["value"]
    assert current["mean mrr"] == pytest.approx((0.1 + 0.5 + 0.6) / 3)
    assert current["mean hits@10"] == pytest.approx(2 * (0.1 + 0.5 + 0.6) / 3)
    assert current["omega_new"] == pytest.approx((0.5 + 0.6) / 2)
    assert np.isnan(current["forward transfer"])
    assert table[table["protocol"] == "lkge"]["value"].isna().all()
