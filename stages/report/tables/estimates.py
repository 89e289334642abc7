"""Means over runs, their intervals over sets of novel entities, and differences with tests.

An estimate takes three columns: its name, ``NAME low`` and ``NAME high``. Seeds, each with its set
of every size, are the units that vary: intervals are Student's t over seeds, at 95 %.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtr, stdtrit

TableRow = dict[str, Any]  #: A row of a table, by column.
Estimate = tuple[float, float, float]  #: A value and the bounds of its interval.
BASELINE = "xavier"  #: The paper's baseline, the reference of all gains.
#: Columns that identify a run of an initializer.
CELL = ["size", "seed"]
#: Measures with their headers: MRR with its two halves, and the form with counts.
MEASURES = {
    "mrr": "MRR",
    "mrr_entity": "entity prediction",
    "mrr_relation": "relation prediction",
    "mrr_star": "MRR*",
}
#: Ends of the names of an estimate's columns.
ENDS = ("", " low", " high")


def where(rows: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """The rows with these values in their columns; a list or tuple: any of them."""
    for column, value in values.items():
        any_of = value if isinstance(value, list | tuple) else [value]
        rows = rows[rows[column].isin(any_of)]
    return rows


def over_seeds(
    rows: pd.DataFrame,
    by: Sequence[str],
    columns: Mapping[str, str],
    scale: float = 100.0,
    least: float = -np.inf,
) -> pd.DataFrame:
    """Means × ``scale`` of ``columns`` (name to new name) by group, with intervals over seeds, none
    below ``least``.

    The mean is over all rows, and seeds may have different numbers of them: its error is that of a
    ratio of two sums over seeds, to first order. With equal numbers it is Student's interval of the
    seeds' means. Nulls are left out; one seed alone has no interval.
    """
    levels = list(by)
    of_seeds = rows.groupby([*levels, "seed"], observed=True)[list(columns)]
    totals, numbers = of_seeds.sum(), of_seeds.count()
    groups = totals.groupby(level=levels, observed=True)
    counts = numbers.groupby(level=levels, observed=True)
    means = groups.sum() / counts.sum()
    errors = totals - numbers * (groups.transform("sum") / counts.transform("sum"))
    squares = (errors**2).groupby(level=levels, observed=True).sum()
    seeds = (numbers > 0).groupby(level=levels, observed=True).sum()
    error = np.sqrt(squares * seeds / (seeds - 1).clip(lower=1)) / counts.sum()
    around = error * _quantile(seeds.to_numpy())
    parts = dict[str, pd.Series]()
    for column, name in columns.items():
        mean, half = scale * means[column], scale * around[column]
        low = (mean - half).clip(lower=least)
        parts |= {name: mean, f"{name} low": low, f"{name} high": mean + half}
    return pd.DataFrame(parts)


def _quantile(seeds: Any) -> Any:
    """The 97.5 % quantile of Student's t for a number of seeds; NaN for one."""
    return stdtrit(np.where(np.asarray(seeds) > 1, np.asarray(seeds) - 1, np.nan), 0.975)


def means_without_each(cells: pd.DataFrame, pooled: bool = False) -> np.ndarray:
    """Means of the columns over S seeds (rows): of all of them, then without each; shape
    (1 + S, columns). Nulls are left out. ``pooled``: the mean over all values, shape (1 + S,).
    """
    values = cells.to_numpy(float)
    weights = np.vstack([np.ones(len(values)), 1 - np.eye(len(values))])
    present = ~np.isnan(values)
    sums, numbers = weights @ np.where(present, values, 0.0), weights @ present
    if pooled:
        sums, numbers = sums.sum(axis=1), numbers.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):  # all are null
        means: np.ndarray = sums / numbers
    return means


def jackknife(values: np.ndarray, least: float = -np.inf) -> Estimate:
    """A statistic of all S seeds and without each of them, (1 + S,), as a value with its interval:
    Student's t with the error of the jackknife, which is the usual one for a mean. No bound is
    below ``least``.
    """
    value, others = float(values[0]), values[1:]
    if not len(others):
        return value, np.nan, np.nan
    error = float(others.std()) * np.sqrt(len(others) - 1)
    around = error * float(_quantile(len(others)))
    return value, float(np.maximum(value - around, least)), value + around


def combined(rows: pd.DataFrame, by: Sequence[str], measure: str = "mrr") -> pd.DataFrame:
    """A measure of the queries of each group, with its halves, in [0, 1] (equation 7).

    The entity half is a mean over relations, weighted by observations, of the mean over a
    relation's head and tail queries. A half without queries is null; then the measure is null.
    ``rows``: of the query breakdown.
    """
    weighted = rows.assign(total=rows[measure] * rows["queries"])
    of_relations = rows["hidden"] == "relation"
    groups = weighted[~of_relations].groupby(list(dict.fromkeys([*by, "relation"])), observed=True)
    sums, weight = groups[["total", "queries"]].sum(), groups["observations"].first()
    shares = pd.DataFrame({"mean": weight * sums["total"] / sums["queries"], "weight": weight})
    shares = shares.groupby(level=list(by)).sum()
    relations = weighted[of_relations].groupby(list(by), observed=True)[["total", "queries"]].sum()
    entity, relation = shares["mean"] / shares["weight"], relations["total"] / relations["queries"]
    halves = pd.DataFrame({f"{measure}_entity": entity, f"{measure}_relation": relation})
    halves.insert(0, measure, halves.mean(axis=1, skipna=False))
    return halves.reset_index()


def difference(first: pd.Series, second: pd.Series) -> dict[str, float]:
    """First minus second, paired by seed: the mean, its interval, p of the paired t-test, the
    number of seeds, and of those that differ.

    Both are indexed by ``CELL`` and averaged by seed; rounded to 1e-9, so that ties do not depend
    on the order of sums.
    """
    values = (first - second).dropna().groupby(level="seed").mean().astype(float).round(9)
    seeds, (mean, error) = len(values), map(float, values.agg(["mean", "sem"]))
    around = error * float(_quantile(seeds))
    return {
        "difference": mean + 0.0,  # no -0
        "difference low": mean - around,
        "difference high": mean + around,
        "p": float(2 * stdtr(seeds - 1, -abs(mean) / error)) if error > 0 else np.nan,
        "seeds": seeds,
        "of these differ": int(np.count_nonzero(values)),
    }


def compare(
    measures: Mapping[str, pd.DataFrame], models: Sequence[str], first: Sequence[str]
) -> pd.DataFrame:
    """All pairs of models in each measure (a frame with a row for each run and a column for each
    model), with Holm's correction within a measure; models in ``first`` come first in a pair.
    """
    rows = list[TableRow]()
    for measure, cells in measures.items():
        of_measure = list[TableRow]()
        for pair in combinations(models, 2):
            left, right = sorted(pair, key=lambda name: name not in first)
            names = {"measure": measure, "first": left, "second": right}
            of_measure.append(names | difference(cells[left], cells[right]))
        corrected = holm(np.array([row["p"] for row in of_measure]))
        for row, p in zip(of_measure, corrected.tolist(), strict=True):
            rows.append(row | {"p (Holm)": p})
    order = ["measure", "first", "second", "difference", "difference low", "difference high"]
    return pd.DataFrame(rows, columns=[*order, "p", "p (Holm)", "seeds", "of these differ"])


def holm(p: np.ndarray) -> np.ndarray:
    """Holm's step-down correction of m values of p:
    the i-th smallest times (m − i + 1), made monotone, at most 1.

    NaN (nothing to test) counts as 1 among the m and stays NaN.
    """
    known = np.nan_to_num(p, nan=1.0)
    order = known.argsort(kind="stable")
    corrected = np.empty(len(p))
    corrected[order] = np.maximum.accumulate(known[order] * np.arange(len(p), 0, -1)).clip(max=1)
    return np.where(np.isnan(p), np.nan, corrected)


def epochs_summary(convergence: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Epochs to convergence by group, in both forms of the authors' program: of all runs, with the
    limit for those that do not end; of the runs that end. Then the number that do not, and of all.
    """
    levels = list(by)
    ended = convergence[convergence["converged"]]
    parts = list[pd.DataFrame]()
    for title, runs in (("", convergence), ("runs that end", ended)):
        means = over_seeds(runs, levels, {"epochs": "mean"}, scale=1, least=0)
        means["deviation"] = runs.groupby(levels)["epochs"].std()
        parts.append(under(means, title))
    summary = pd.concat(parts, axis=1)
    groups = convergence.groupby(levels)["converged"]
    summary["do not end"] = groups.size() - groups.sum()
    summary["runs"] = groups.size()
    return summary


def cells_of(rows: pd.DataFrame, models: Sequence[str], scope: str, column: str) -> pd.DataFrame:
    """Values of ``column`` in a scope: a row for each size and seed, a column for each model."""
    shown = where(rows, scope=scope)
    return shown.pivot(index=CELL, columns="model", values=column).reindex(columns=list(models))


def wide(estimates: pd.DataFrame, column: str, names: Mapping[str, str]) -> dict[str, float]:
    """One row with the estimate ``column`` of each model (the index), under the model's label."""
    row = dict[str, float]()
    for model, values in estimates.iterrows():
        row |= named(values, column, names[str(model)])
    return row


def under(estimates: pd.DataFrame, group: str) -> pd.DataFrame:
    """The same columns under the header of a group."""
    return estimates.add_prefix(f"{group}: ") if group else estimates


def named(estimates: Any, column: str, title: str) -> dict[str, Any]:
    """The estimate ``column`` of a frame or a row, with its bounds, under a title."""
    return {f"{title}{end}": estimates[f"{column}{end}"] for end in ENDS}


def bounded(title: str, estimate: Estimate) -> dict[str, float]:
    """The columns of an estimate."""
    return {f"{title}{end}": value for end, value in zip(ENDS, estimate, strict=True)}
