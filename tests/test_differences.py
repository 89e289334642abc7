"""Paired differences, Holm's correction and shares of the gain, against values by hand."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from isi.evaluation.query_sets import epochs_to_convergence
from isi.report import stats
from isi.report.sections import immediate
from tests.reports import frame_of, runs

#: MRR* of one model by (size, seed).
Cells = dict[tuple[int, int], float]
NOVEL = "immediate MRR*, novel entities"
POINTS = st.lists(st.integers(-50, 50).map(lambda number: number / 4), min_size=2, max_size=12)


def runs_of(models: dict[str, Cells], scope: str = "novel") -> pd.DataFrame:
    """Runs of the models at epoch 0."""
    return runs(
        [
            (model, scope, size, seed, 0, value)
            for model, cells in models.items()
            for (size, seed), value in cells.items()
        ]
    )


def measures_of(models: dict[str, Cells]) -> dict[str, pd.DataFrame]:
    """Headline measures of initializers that have MRR* at epoch 0 alone."""
    nothing = pd.DataFrame(columns=["scope", "model", "session", "size", "seed", "epochs"])
    rows = runs_of(models).assign(mrr_star_entity=np.nan)
    return immediate.measures(rows, nothing, list(models))


def pairs_of(models: dict[str, Cells]) -> list[stats.Pair]:
    return stats.compare(measures_of(models), list(models))


def short_table(models: dict[str, Cells]) -> pd.DataFrame:
    return frame_of(immediate.differences_isi(pairs_of(models), list(models)))


def by_measure(pairs: list[stats.Pair], measure: str) -> list[stats.Pair]:
    return [pair for pair in pairs if pair.measure == measure]


def constant(value: float, seeds: int = 3) -> Cells:
    return {(1, seed): value for seed in range(seeds)}


# Holm


def test_holm_by_hand() -> None:
    # in order 0.005 · 4, 0.01 · 3, 0.03 · 2, and 0.04 · 1, which may not fall below the one before
    assert stats.holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx(
        [0.03, 0.06, 0.06, 0.02]
    )
    assert stats.holm(np.array([0.6, 0.5])) == pytest.approx([1, 1])
    # a pair that does not differ counts among the tests
    assert stats.holm(np.array([np.nan, 0.01, np.nan])) == pytest.approx(
        [np.nan, 0.03, np.nan], nan_ok=True
    )


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_holm_never_lowers_a_p_nor_changes_the_order(values: list[float]) -> None:
    p = np.array(values)
    corrected = stats.holm(p)
    assert ((corrected >= p) & (corrected <= 1)).all()
    assert (np.diff(corrected[p.argsort()]) >= 0).all()
    assert corrected.min() == min(1, len(p) * p.min())  # Bonferroni's for the smallest


# Differences


def test_cells_without_queries_for_either_are_left_out_of_both_sides() -> None:
    nan = np.nan
    first = {(1, 0): 0.6, (2, 0): 0.9, (1, 1): 0.5, (2, 1): 0.3, (1, 2): nan, (2, 2): 0.7}
    second = {(1, 0): 0.5, (2, 0): nan, (1, 1): 0.1, (2, 1): 0.5, (1, 2): 0.2, (2, 2): nan}
    (found,) = by_measure(pairs_of({"es": first, "rs": second}), NOVEL)
    # seed 2 has no cell of both
    assert found.difference.mean == pytest.approx((10 + (40 - 20) / 2) / 2)
    assert found.difference.seeds == 2


@settings(max_examples=40)
@given(POINTS)
def test_p_is_scipys_over_all_permutations(values: list[float]) -> None:
    def total(sample: np.ndarray, axis: int) -> np.ndarray:
        summed: np.ndarray = sample.sum(axis)
        return summed

    difference = stats.difference(np.array(values))
    exact = (
        scipy.stats.permutation_test(
            (np.array(values),),
            total,
            permutation_type="samples",
            n_resamples=np.inf,
            vectorized=True,
        ).pvalue
        if any(values)
        else np.nan
    )
    assert difference.p == pytest.approx(exact, nan_ok=True)
    assert difference.mean == pytest.approx(np.mean(values))
    assert (difference.seeds, difference.differing) == (len(values), np.count_nonzero(values))


def test_many_seeds_are_counted_and_very_many_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).normal(0.4, 1, 30).round(9)
    exact = stats.sign_flip(values)
    assert exact * 2**29 == pytest.approx(round(exact * 2**29))  # a number of pairs of ways
    monkeypatch.setattr(stats, "_COUNTED", 29)
    assert stats.sign_flip(values) == pytest.approx(exact, abs=0.005)
    assert stats.sign_flip(np.ones(60)) == pytest.approx(1 / 100_000)


def test_the_interval_is_the_bootstraps() -> None:
    # of two seeds, a resampled mean is 0, ½ or 1 with ¼, ½ and ¼
    two = stats.difference(np.array([0.0, 1.0]))
    assert (two.low, two.high) == (0, 1)
    same = stats.difference(np.full(4, 2.0))
    assert (same.low, same.high) == (2, 2)
    alone = stats.difference(np.array([1.0]))
    assert np.isnan([alone.low, alone.high]).all()


@settings(max_examples=25)
@given(POINTS)
def test_a_swapped_pair_is_the_same_with_other_signs(values: list[float]) -> None:
    one, other = (stats.difference(sign * np.array(values)) for sign in (1, -1))
    assert (other.mean, other.low, other.high) == pytest.approx((-one.mean, -one.high, -one.low))
    assert one.low <= one.mean + 1e-9
    assert one.mean <= one.high + 1e-9
    assert other.p == pytest.approx(one.p, nan_ok=True)
    assert 0 <= one.p <= 1 if any(values) else np.isnan(one.p)


def test_rounding_is_no_difference() -> None:
    first = pd.Series(
        [0.1 + 0.2, 0.5], pd.MultiIndex.from_tuples([(1, 0), (1, 1)], names=["size", "seed"])
    )
    second = pd.Series([0.3, 0.5], first.index)
    assert (first != second).any()
    assert not stats.by_seed(first, second).any()


def test_identical_runs_give_none() -> None:
    pairs = pairs_of({"xavier": constant(0.4), "es": constant(0.6), "rs": constant(0.6)})
    frame = frame_of(stats.pairs_table(pairs))
    novel = frame[frame["measure"] == NOVEL].set_index(["first", "second"])
    assert novel.loc[("ES", "RS"), ["p", "p (Holm)"]].tolist() == ["none", "none"]
    assert novel.loc[("ES", "RS"), ["difference", "of these differ"]].tolist() == [0, 0]
    # ISI stands first; both p are 2 / 2³, and the pair without a difference counts among the three
    assert novel.loc[("ES", "Xavier"), "difference"] == pytest.approx(20)
    assert novel.loc[("RS", "Xavier"), ["p", "p (Holm)"]].tolist() == [0.25, 0.75]


def test_epochs_are_compared_in_the_scopes_of_convergence() -> None:
    joint = runs([("joint", "all", 1, seed, 0, 0.7) for seed in range(2)])
    rows = runs(
        [
            ("xavier", "all", 1, seed, epoch, mrr)
            for seed in range(2)
            for epoch, mrr in enumerate((0.1, 0.5, 0.65))
        ]
        + [("es", "all", 1, 0, 0, 0.66), ("es", "all", 1, 1, 0, 0.6), ("es", "all", 1, 1, 1, 0.7)]
    )
    convergence = epochs_to_convergence(rows, joint, 0.08, 150, ["model"]).assign(session=1)
    start = rows[rows["epoch"] == 0].assign(mrr_star_entity=0.5)
    found = immediate.measures(start, convergence, ["xavier", "es"])
    pairs = stats.compare(found, ["xavier", "es"])
    (pair,) = by_measure(pairs, "epochs to convergence, all queries")
    assert (pair.first, pair.second) == ("es", "xavier")
    assert pair.difference.mean == pytest.approx((0 + 1) / 2 - 2)
    assert (
        by_measure(pairs, "epochs to convergence, novel entities, held-out triples")[
            0
        ].difference.seeds
        == 0
    )


def test_another_initializer_changes_nothing_but_the_correction() -> None:
    draw = np.random.default_rng(0)
    models = {
        name: {(size, seed): float(draw.random()) for size in (1, 2) for seed in range(8)}
        for name in ("xavier", "es", "mean")
    }
    few, more = (
        next(
            pair
            for pair in pairs_of({name: models[name] for name in names})
            if (pair.measure, pair.second) == (NOVEL, "mean")
        )
        for names in (("es", "mean"), ("es", "mean", "xavier"))
    )
    assert replace(few, holm=0) == replace(more, holm=0)
    assert few.holm < more.holm


def test_the_short_table_sets_isi_against_all_others() -> None:
    seeds = 8
    models = {
        "xavier": constant(0.4, seeds),
        "es": constant(0.6, seeds),
        "rs": constant(0.7, seeds),
        "mean": {(1, seed): 0.6 + 0.01 * (-1) ** seed for seed in range(seeds)},
    }
    frame = short_table(models).set_index(["ISI", "against"])
    assert list(frame.index) == [("ES", "Xavier"), ("ES", "Mean"), ("RS", "Xavier"), ("RS", "Mean")]
    novel = frame[NOVEL]
    assert novel["RS", "Xavier"] == "+30.00 [+30.00, +30.00]"
    assert novel["ES", "Mean"].startswith("+0.00 [")
    assert novel["ES", "Mean"].endswith("] n.s.")
    assert frame["immediate MRR*, all queries"].isna().all()  # no queries


def test_pairs_that_do_not_differ_significantly_are_counted_and_named() -> None:
    seeds = 8
    models = {
        "xavier": constant(0.4, seeds),
        "es": constant(0.6, seeds),
        "rs": constant(0.6, seeds),
    }
    (novel,) = immediate.counts(pairs_of(models))
    assert (novel["measure"], novel["significant"], novel["number"], novel["too_few_seeds"]) == (
        NOVEL,
        2,
        3,
        None,
    )
    assert [(pair.first, pair.second) for pair in novel["same"]] == [("es", "rs")]
    # 3 pairs · 2 / 2⁶ is above 0.05
    few = {name: constant(cells[1, 0], 6) for name, cells in models.items()}
    (novel,) = immediate.counts(pairs_of(few))
    assert (novel["significant"], novel["too_few_seeds"], novel["same"]) == (0, 6, [])
    del models["rs"]
    (novel,) = immediate.counts(pairs_of(models))
    assert (novel["significant"], novel["number"], novel["same"]) == (1, 1, [])


@pytest.mark.parametrize("names", [["xavier"], ["es"], ["xavier", "mean"], ["es", "mean"]])
def test_tables_are_whole_where_there_is_nothing_to_compare(names: list[str]) -> None:
    models = {name: constant(0.5) for name in names}
    assert len(stats.pairs_table(pairs_of(models))) == (5 if len(names) == 2 else 0)
    assert short_table(models).empty == (names != ["es", "mean"])
