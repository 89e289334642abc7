"""Paired differences, Holm's correction and shares of the gain, worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from isi.learning.convergence import epochs_to_convergence
from isi.report import page
from isi.report.sections import controls, differences
from tests.reports import runs

#: MRR* of one model by (size, seed).
Cells = dict[tuple[int, int], float]
NOVEL = "immediate MRR*, scope novel"
POINTS = st.lists(st.integers(-50, 50).map(lambda number: number / 4), min_size=2, max_size=12)


def at_once(models: dict[str, Cells], scope: str = "novel") -> pd.DataFrame:
    """Runs of these models right after insertion."""
    return runs([(model, scope, size, seed, 0, value) for model, cells in models.items()
                 for (size, seed), value in cells.items()])  # fmt: skip


def measures_of(models: dict[str, Cells]) -> dict[str, pd.DataFrame]:
    """Measures of initializers of which nothing is known but how they start."""
    nothing = pd.DataFrame(columns=["scope", "model", "session", "size", "seed", "epochs"])
    return differences.measures(at_once(models), nothing, list(models))


def pairs_of(models: dict[str, Cells]) -> list[differences.Pair]:
    return differences.compare(measures_of(models), list(models), root=0)


def short_table(models: dict[str, Cells]) -> pd.DataFrame:
    return differences.differences_isi(pairs_of(models), list(measures_of(models)), list(models)).frame


def by_measure(pairs: list[differences.Pair], measure: str) -> list[differences.Pair]:
    return [pair for pair in pairs if pair.measure == measure]


def shares_of(models: dict[str, Cells]) -> list[controls.Share]:
    return controls.shares(at_once(models), list(models))


def constant(value: float, seeds: int = 3) -> Cells:
    return {(1, seed): value for seed in range(seeds)}


# Holm


def test_holm_by_hand() -> None:
    # in order 0.005 · 4, 0.01 · 3, 0.03 · 2, and 0.04 · 1, which may not fall below the one before
    assert differences.holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert differences.holm(np.array([0.6, 0.5])) == pytest.approx([1, 1])
    assert differences.holm(np.array([0.2])) == pytest.approx([0.2])


def test_a_pair_that_does_not_differ_stays_among_the_tests_of_holm() -> None:
    corrected = differences.holm(np.array([np.nan, 0.01, np.nan]))
    assert corrected[1] == pytest.approx(0.03)
    assert np.isnan(corrected[[0, 2]]).all()


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_holm_never_lowers_a_p_nor_changes_the_order(values: list[float]) -> None:
    p = np.array(values)
    corrected = differences.holm(p)
    assert ((corrected >= p) & (corrected <= 1)).all()
    assert (np.diff(corrected[p.argsort()]) >= 0).all()
    assert corrected.min() == min(1, len(p) * p.min())  # Bonferroni's for the smallest


# Differences


def test_cells_without_queries_for_either_are_left_out_of_both_sides() -> None:
    nan = np.nan
    first = {(1, 0): 0.6, (2, 0): 0.9, (1, 1): 0.5, (2, 1): 0.3, (1, 2): nan, (2, 2): 0.7}
    second = {(1, 0): 0.5, (2, 0): nan, (1, 1): 0.1, (2, 1): 0.5, (1, 2): 0.2, (2, 2): nan}
    (found,) = by_measure(pairs_of({"es": first, "rs": second}), NOVEL)
    assert found.mean == pytest.approx((10 + (40 - 20) / 2) / 2)  # seed 2 has no cell of both
    assert found.seeds == 2


@pytest.mark.parametrize(
    ("values", "p"),
    [
        ([1, 2, 3, 4, 5], 2 / 2**5),  # all of one sign
        ([1, 2, 3, -4], 14 / 16),  # 7 of 16 sets of ranks sum to 4 or less
        ([0, 1, 2, 3], 2 / 2**3),  # a seed without a difference is not ranked
        ([2.5], 1),
    ],
)
def test_p_is_wilcoxons_by_hand(values: list[float], p: float) -> None:
    found = differences.difference(np.array(values, dtype=float), root=0)
    assert found.p == pytest.approx(p)
    assert found.mean == pytest.approx(sum(values) / len(values))
    assert found.seeds == len(values)


def test_the_interval_is_the_bootstraps() -> None:
    # of two seeds, a resampled mean is 0, ½ or 1 with ¼, ½ and ¼
    two = differences.difference(np.array([0.0, 1.0]), root=0)
    assert (two.low, two.high) == (0, 1)
    same = differences.difference(np.full(4, 2.0), root=0)
    assert (same.low, same.high) == (2, 2)
    values = np.random.default_rng(5).normal(3, 2, 200)
    many = differences.difference(values, root=0)
    half = stats.norm.ppf(0.975) * values.std() / 200**0.5
    assert (many.low, many.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.05 * half)
    alone = differences.difference(np.array([1.0]), root=0)
    assert np.isnan([alone.low, alone.high]).all()


@settings(max_examples=25, deadline=None)
@given(POINTS)
def test_a_swapped_pair_is_the_same_with_other_signs(values: list[float]) -> None:
    one, other = (differences.difference(sign * np.array(values), root=3) for sign in (1, -1))
    assert (other.mean, other.low, other.high) == pytest.approx((-one.mean, -one.high, -one.low))
    assert one.low <= one.mean + 1e-9
    assert one.mean <= one.high + 1e-9
    assert other.p == pytest.approx(one.p, nan_ok=True)
    assert 0 <= one.p <= 1 if any(values) else np.isnan(one.p)


def test_rounding_is_no_difference() -> None:
    first = pd.Series([0.1 + 0.2, 0.5], pd.MultiIndex.from_tuples([(1, 0), (1, 1)], names=["size", "seed"]))
    second = pd.Series([0.3, 0.5], first.index)
    assert (first != second).any()
    assert not differences.by_seed(first, second).any()


def test_identical_runs_give_none() -> None:
    pairs = pairs_of({"xavier": constant(0.4), "es": constant(0.6), "rs": constant(0.6)})
    frame = differences.differences(pairs).frame
    novel = frame[frame["measure"].str.endswith("scope novel")].set_index(["first", "second"])
    assert novel.loc[("ES", "RS"), ["p", "p (Holm)"]].tolist() == ["none", "none"]
    assert novel.loc[("ES", "RS"), "difference"] == 0
    # ISI stands first; both p are 2 / 2³, and the pair without a difference counts among the three
    assert novel.loc[("ES", "Xavier"), "difference"] == pytest.approx(20)
    assert novel.loc[("RS", "Xavier"), ["p", "p (Holm)"]].tolist() == [0.25, 0.75]


def test_epochs_are_compared_in_the_scopes_of_convergence() -> None:
    joint = runs([("joint", "all", 1, seed, 0, 0.7) for seed in range(2)])
    rows = runs(
        [("xavier", "all", 1, seed, epoch, mrr) for seed in range(2) for epoch, mrr in enumerate((0.1, 0.5, 0.65))]
        + [("es", "all", 1, 0, 0, 0.66), ("es", "all", 1, 1, 0, 0.6), ("es", "all", 1, 1, 1, 0.7)]
    )
    convergence = epochs_to_convergence(rows, joint, 0.08, 150, ["model"]).assign(session=1)
    found = differences.measures(rows[rows["epoch"] == 0], convergence, ["xavier", "es"])
    pairs = differences.compare(found, ["xavier", "es"], root=0)
    (pair,) = by_measure(pairs, "epochs to convergence, scope all")
    assert (pair.first, pair.second) == ("es", "xavier")
    assert pair.mean == pytest.approx((0 + 1) / 2 - 2)
    assert by_measure(pairs, "epochs to convergence, scope novel_heldout")[0].seeds == 0


def test_another_initializer_changes_nothing_but_the_correction() -> None:
    draw = np.random.default_rng(0)
    models = {name: {(size, seed): float(draw.random()) for size in (1, 2) for seed in range(8)}
              for name in ("xavier", "es", "mean")}  # fmt: skip
    few, more = (
        next(
            pair
            for pair in by_measure(pairs_of({name: models[name] for name in names}), NOVEL)
            if pair.second == "mean"
        )
        for names in (("es", "mean"), ("es", "mean", "xavier"))
    )
    assert replace(few, holm=0) == replace(more, holm=0)
    assert few.holm < more.holm


def test_the_short_table_sets_isi_against_all_others() -> None:
    seeds = 8
    models = {"xavier": constant(0.4, seeds), "es": constant(0.6, seeds), "rs": constant(0.7, seeds),
              "mean": {(1, seed): 0.6 + 0.01 * (-1) ** seed for seed in range(seeds)}}  # fmt: skip
    frame = short_table(models).set_index(["ISI", "against"])
    assert list(frame.index) == [("ES", "Xavier"), ("ES", "Mean"), ("RS", "Xavier"), ("RS", "Mean")]
    novel = frame[NOVEL]
    assert novel["RS", "Xavier"] == "+30.00 [+30.00, +30.00]"
    assert novel["ES", "Mean"].startswith("+0.00 [")
    assert novel["ES", "Mean"].endswith("] n.s.")
    assert frame["immediate MRR*, scope all"].isna().all()  # no queries


def test_sentences_name_the_pairs_that_are_not_told_apart() -> None:
    seeds = 8
    models = {"xavier": constant(0.4, seeds), "es": constant(0.6, seeds), "rs": constant(0.6, seeds)}
    assert differences.sentences(pairs_of(models)) == [
        "Immediate MRR*, scope novel: 2 of 3 pairs are told apart, not so ES and RS."
    ]
    few = {name: constant(cells[1, 0], 6) for name, cells in models.items()}  # 3 pairs · 2 / 2⁶ is above 0.05
    assert differences.sentences(pairs_of(few)) == [
        "Immediate MRR*, scope novel: 0 of 3 pairs are told apart (with 6 seeds none can be)."
    ]
    del models["rs"]
    assert differences.sentences(pairs_of(models)) == ["Immediate MRR*, scope novel: 1 of 1 pairs are told apart."]


@pytest.mark.parametrize("names", [("xavier",), ("es",), ("xavier", "mean")])
def test_tables_are_whole_where_there_is_nothing_to_compare(names: tuple[str, ...]) -> None:
    models = {name: constant(0.5) for name in names}
    every, pairs = differences.differences(pairs_of(models)), 4 if len(names) == 2 else 0
    shared = controls.shares_of_the_gain(shares_of(models))
    for frame, formats, rows in (
        (every.frame, every.formats, pairs),
        (short_table(models), {}, 0),
        (shared.frame, {}, 0),
    ):
        shown = page.shorten(frame, formats)
        assert len(shown.columns) == len(frame.columns) > 0
        assert len(shown) == rows


def test_p_values_and_differences_are_shown_as_people_read_them() -> None:
    frame = pd.DataFrame({"p": [0.00042, 0.0314159, "none"], "difference": [0.014, -20.5, 0.0]})
    table = differences.differences(pairs_of({"es": constant(0.5), "rs": constant(0.6)}))
    shown = page.shorten(frame, table.formats)
    assert shown["p"].tolist() == ["< 0.001", "0.031", "none"]
    assert shown["difference"].tolist() == ["+0.01", "-20.50", "+0.00"]


# Shares of the gain


def test_shares_by_hand() -> None:
    found = shares_of({"xavier": {(1, 0): 0.3, (2, 0): 0.5}, "es": {(1, 0): 0.5, (2, 0): 0.7},
                       "mean": {(1, 0): 0.5, (2, 0): 0.5}, "gaussian": {(1, 0): 0.3, (2, 0): 0.4}})  # fmt: skip
    mean, gaussian = found
    assert (mean.gain, mean.percent, mean.rest) == pytest.approx((20, 50, 10))
    assert (gaussian.gain, gaussian.percent, gaussian.rest) == pytest.approx((20, -25, 25))
    frame = controls.shares_of_the_gain(found).frame
    assert frame["scope"].tolist() == ["novel", "novel"]
    assert frame["share %"].tolist() == pytest.approx([50, -25])


def said(es: float, **others: float) -> str:
    """The sentence on ES where Xavier has 40 points."""
    cells = {name: constant(value) for name, value in others.items()}
    (text,) = controls.sentences(shares_of({"xavier": constant(0.4), "es": constant(es)} | cells))
    return text


def test_sentences_are_true_whatever_the_numbers() -> None:
    assert said(0.6, mean=0.55, gaussian=0.39, gaussian_centred=0.4) == (
        "In scope novel, ES gains 20.0 points over Xavier. Of these Mean has 75 %; Gaussian has none, being 1.0 points "
        "below Xavier; Centred Gaussian has none; beyond the best of them, Mean, 5.0 points remain for semantics."
    )
    assert said(0.6, es_permuted=0.62) == (
        "In scope novel, ES gains 20.0 points over Xavier. Of these Permuted ES has 110 %; nothing remains for "
        "semantics: Permuted ES is 2.0 points ahead."
    )
    assert said(0.6, mean=0.5998) == (  # less than is shown
        "In scope novel, ES gains 20.0 points over Xavier. Of these Mean has 100 %; nothing remains for semantics: "
        "Mean has as much."
    )


@pytest.mark.parametrize(("es", "below"), [(0.4, ""), (0.3, ": it is 10.0 points below")])
def test_where_nothing_is_gained_nothing_is_shared(es: float, below: str) -> None:
    assert said(es, mean=0.5) == f"In scope novel, ES gains nothing over Xavier{below}, so there is nothing to share."
    (share,) = shares_of({"xavier": constant(0.4), "es": constant(es), "mean": constant(0.5)})
    assert np.isnan(share.percent)
    assert share.rest == pytest.approx(100 * (es - 0.5))


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=50, deadline=None)
def test_share_and_rest_make_the_gain(xavier: float, es: float, control: float) -> None:
    share = controls.Share("all", "es", 100 * (es - xavier), "mean", 100 * (control - xavier))
    assert share.control_gain + share.rest == pytest.approx(share.gain, abs=1e-9)
    if es > xavier + 0.01:
        assert share.percent / 100 * share.gain == pytest.approx(share.control_gain, abs=1e-9)
    assert "nan" not in controls.sentence([share])


def test_without_xavier_there_is_no_gain() -> None:
    assert shares_of({"es": constant(0.6), "mean": constant(0.5)}) == []
