"""Means, intervals, differences and forms of numbers, against scipy and values by hand."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from stages.report.tables import forms
from stages.report.tables.estimates import (
    CELL,
    compare,
    difference,
    epochs_summary,
    holm,
    jackknife,
    means_without_each,
    over_seeds,
)

#: 97.5 % quantile of Student's t for two seeds.
T2 = scipy.stats.t.ppf(0.975, 1)
NAN = float("nan")
POINTS = st.lists(st.integers(-50, 50).map(lambda number: number / 4), min_size=2, max_size=12)


def of_seeds(*seeds: Sequence[float]) -> pd.DataFrame:
    """Rows of one group, with the values of each seed."""
    rows = [("group", seed, value) for seed, values in enumerate(seeds) for value in values]
    return pd.DataFrame(rows, columns=["group", "seed", "value"])


def estimate(rows: pd.DataFrame, scale: float = 1) -> list[float]:
    return list(over_seeds(rows, ["group"], {"value": "v"}, scale).loc["group"])


def cells(*values: Sequence[float]) -> pd.Series:
    """Values by size (of each seed)."""
    places = [(size, seed) for seed, of in enumerate(values) for size in range(len(of))]
    index = pd.MultiIndex.from_tuples(places, names=CELL)
    return pd.Series([value for of in values for value in of], index, dtype=float)


# Means over seeds


@given(st.lists(st.lists(st.floats(0, 1), min_size=3, max_size=3), min_size=2, max_size=8))
def test_with_equal_numbers_the_interval_is_students_of_the_seeds_means(
    values: list[list[float]],
) -> None:
    means = np.mean(values, axis=1)
    around = scipy.stats.sem(means) * scipy.stats.t.ppf(0.975, len(values) - 1)
    expected = [means.mean(), means.mean() - around, means.mean() + around]
    assert estimate(of_seeds(*values)) == pytest.approx(expected, abs=1e-9)


def test_seeds_with_more_rows_weigh_more_and_nulls_nothing() -> None:
    # sums of errors are ±3, so the error is sqrt(18 · 2) / 3 rows
    assert estimate(of_seeds([1, 2], [6])) == pytest.approx([3, 3 - 2 * T2, 3 + 2 * T2])
    nulls = of_seeds([1, 2, NAN], [NAN], [3])
    assert estimate(nulls) == pytest.approx([2, 2 - T2 * 2 / 3, 2 + T2 * 2 / 3])
    assert estimate(of_seeds([1, 2]), 100) == pytest.approx([150, NAN, NAN], nan_ok=True)


def test_convergence_has_means_medians_and_shares() -> None:
    epochs = of_seeds([1, 2], [3, 150]).rename(columns={"value": "epochs"})
    found = epochs_summary(epochs.assign(converged=epochs["epochs"] < 150), ["group"]).loc["group"]
    expected = {
        "mean": 39,
        "mean low": 0,  # not 39 - 37.5 * T2
        "deviation": np.std([1, 2, 3, 150], ddof=1),
        "runs that end: mean": 2,
        "runs that end: deviation": 1,
        "do not end": 1,
        "runs": 4,
    }
    assert found[list(expected)].to_dict() == pytest.approx(expected)


# Statistics of sets


@given(st.lists(st.floats(0, 1), min_size=2, max_size=8))
def test_the_jackknife_of_a_mean_is_students_interval(values: list[float]) -> None:
    found = jackknife(means_without_each(pd.DataFrame({"x": values}))[:, 0])
    assert found == pytest.approx(estimate(of_seeds(*([value] for value in values))), abs=1e-9)


def test_without_each_seed_its_nulls_are_left_out_of_means() -> None:
    cells = pd.DataFrame({"a": [1.0, NAN, 3.0], "b": [NAN, 2.0, NAN]})
    found = means_without_each(cells).tolist()
    expected = [[2, 2], [3, 2], [2, NAN], [1, 2]]
    assert found == [pytest.approx(row, nan_ok=True) for row in expected]


# Differences


@given(POINTS)
def test_a_difference_is_scipys_paired_t_test(values: list[float]) -> None:
    first, second = cells(*([value] for value in values)), cells(*([0.0] for _ in values))
    found, swapped = difference(first, second), difference(second, first)
    assert found["seeds"] == len(values)
    assert found["of these differ"] == np.count_nonzero(values)
    ends = [found["difference low"], found["difference high"]]
    assert [swapped["difference"], swapped["difference high"], swapped["difference low"]] == (
        pytest.approx([-np.mean(values), -ends[0], -ends[1]])
    )
    assert swapped["p"] == pytest.approx(found["p"], nan_ok=True)
    if len(set(values)) == 1:
        assert np.isnan(found["p"])
        assert ends == [values[0]] * 2
    else:
        test = scipy.stats.ttest_rel(values, [0.0] * len(values))
        assert found["p"] == pytest.approx(test.pvalue)
        assert ends == pytest.approx([*test.confidence_interval(0.95)])


def test_cells_without_queries_for_either_are_left_out_of_both_sides() -> None:
    found = difference(cells([60, 90], [50, 30], [NAN, 70]), cells([50, NAN], [10, 50], [20, NAN]))
    assert (found["difference"], found["seeds"]) == ((10 + (40 - 20) / 2) / 2, 2)
    alone = difference(cells([1.0]), cells([0.5]))
    assert alone["difference"] == 0.5
    assert np.isnan([alone["difference low"], alone["p"]]).all()
    nothing = difference(cells([NAN]), cells([0.5]))
    assert nothing["seeds"] == 0


def test_rounding_is_no_difference() -> None:
    assert difference(cells([0.1 + 0.2], [0.5]), cells([0.3], [0.5]))["of these differ"] == 0


def test_holm_by_hand() -> None:
    # in order 0.005 · 4, 0.01 · 3, 0.03 · 2, and 0.04 · 1, which may not fall below the one before
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(np.array([0.6, 0.5])) == pytest.approx([1, 1])
    # a pair that does not differ counts among the tests
    assert holm(np.array([NAN, 0.01, NAN])) == pytest.approx([NAN, 0.03, NAN], nan_ok=True)


def test_isi_stands_first_and_another_initializer_changes_nothing_but_the_correction() -> None:
    draw, names = np.random.default_rng(0), ["xavier", "mean", "es", "rs"]
    index = cells([0, 0], [0, 0], [0, 0]).index
    frame = pd.DataFrame(draw.random((6, 4)), index, names).assign(rs=lambda table: table["es"])
    pair = ["first", "second"]
    more = compare({"a": frame, "b": 2 * frame}, names, ["es", "rs"]).set_index("measure")
    assert len(more.loc["a"]) == 6
    of_more = more.loc["a"].set_index(pair)
    assert ("es", "xavier") in of_more.index
    assert ("xavier", "mean") in of_more.index
    assert np.isnan(of_more.loc[("es", "rs"), ["p", "p (Holm)"]].astype(float)).all()
    few = compare({"a": frame}, ["xavier", "es"], ["es"]).set_index(pair).loc["es", "xavier"]
    same = of_more.loc["es", "xavier"]
    kept = ["difference", "difference low", "difference high", "p", "seeds"]
    assert few[kept].tolist() == same[kept].tolist()
    assert few["p"] == few["p (Holm)"] < same["p (Holm)"]
    assert more.loc["b", "p (Holm)"].tolist() == pytest.approx(
        more.loc["a", "p (Holm)"].tolist(), nan_ok=True
    )


# Numbers in files


def test_numbers_of_files_have_two_decimals_or_four_digits() -> None:
    frame = pd.DataFrame(
        {"a": [1.23456, None, -0.001], "p": ["none", 1.86265e-9, 0.123456], "n": [1, 2, 3]}
    )
    assert forms.csv(frame) == "a,p,n\n1.23,none,1\n,1.863e-09,2\n0,0.1235,3\n"
    rates = pd.DataFrame({"rate": [24941.0, 0.00123456, 77.00000001, 12345.678]})
    rates.attrs[forms.ANY_SIZE] = ["rate"]
    assert forms.csv(rates) == "rate\n24941\n0.001235\n77\n12345.68\n"
    assert forms.shown(rates)["rate"].tolist() == ["24,941", "0.0012", "77", "12345.7"]


@pytest.mark.parametrize(
    ("name", "values", "texts"),
    [
        ("whole", [1.0, NAN, 1234.0], ["1", "–", "1,234"]),
        ("part", [0.05, 1.25, -0.01], ["0.1", "1.2", "0.0"]),
        ("text", ["a", None, "c"], ["a", "–", "c"]),
        ("p", [0.0004, 0.04, NAN], ["< 0.001", "0.040", "–"]),
        ("p (Holm)", [0.0012, 1.0, 0.5], ["0.001", "1.000", "0.500"]),
        ("difference", [1.5, -0.001, -3.0], ["+1.50", "+0.00", "-3.00"]),
        ("ES minus Xavier", [1.0, 0.0, -2.0], ["+1.00", "+0.00", "-2.00"]),
        ("all: change", [1.0, 0.0, -2.0], ["+1.00", "+0.00", "-2.00"]),
    ],
)
def test_numbers_are_shown_as_people_read_them(
    name: str, values: list[object], texts: list[str]
) -> None:
    assert forms.shown(pd.DataFrame({name: values}))[name].tolist() == texts


def test_an_estimate_is_one_cell_for_people_and_three_columns_in_files() -> None:
    frame = pd.DataFrame(
        {"model": ["a_b", "c"], "x": [1.0, 2.0], "x low": [0.5, NAN], "x high": [2.0, NAN]}
    )
    texts = forms.files(frame)
    assert texts["csv"].splitlines() == ["model,x,x low,x high", "a_b,1,0.5,2", "c,2,,"]
    assert "| 1.0 [0.5, 2.0] |" in texts["md"]
    assert r"a\_b & 1.0 [0.5, 2.0] \\" in texts["tex"]
    assert r"\begin{tabular}{lr}" in texts["tex"]
