"""Means over runs with bootstrap intervals over seeds, MRR* of any part of the queries,
and differences with tests.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, reduce
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from isi.random import stream
from isi.report.tables import Cells, Column, Estimate, Rows
from isi.report.words import BASELINE, HALVES, SCOPE, Names, isi, label

#: Columns that identify a run of an initializer.
CELL = ["session", "size", "seed"]
#: Role of the novel entity in a query of scope ``novel``: values of column ``novel`` of
#: ``QUERY_BREAKDOWN``.
DIRECTIONS = {"given": "novel entity given", "answer": "novel entity is the answer"}
RESAMPLES = 9_999
#: A difference is significant where its corrected p is below this.
LEVEL = 0.05
#: Format of a difference.
signed = "{:+.2f}".format
#: The sign-flip test is exact up to ``_COUNTED`` nonzero differences; beyond, it samples ``_DRAWN``
#: choices of signs.
_COUNTED, _DRAWN = 40, 99_999
#: Values and estimates by model, and values by scope, then by model.
Values = dict[str, float]
Estimates = dict[str, Estimate]
ByScope = dict[str, Values]


@dataclass(frozen=True)
class Difference(Estimate):
    """A mean difference over ``seeds`` seeds; ``p``: sign-flip test on the
    ``differing`` seeds with a difference.
    """

    p: float = np.nan
    seeds: int = 0
    differing: int = 0


@dataclass(frozen=True)
class Pair:
    """The difference ``first`` minus ``second`` in one measure;
    ``holm``: p corrected over the measure's pairs.
    """

    measure: str
    first: str
    second: str
    difference: Difference
    holm: float

    @property
    def significant(self) -> bool:
        return self.holm < LEVEL


def where(rows: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """The rows with these values in their columns; a list or tuple: any of them."""
    for column, value in values.items():
        listed = value if isinstance(value, list | tuple) else [value]
        rows = rows[rows[column].isin(listed)]
    return rows


def by_scope(values: pd.Series, models: Names) -> ByScope:
    """Values indexed by (scope, model) as a mapping for each scope, in the order of ``models``."""
    return {
        str(scope): {
            model: float(values[scope, model]) for model in models if (scope, model) in values.index
        }
        for scope in values.index.unique("scope")
    }


def means(rows: pd.DataFrame, column: str, scale: float = 100) -> Values:
    """Mean of a column times ``scale`` for each model, without an interval."""
    by_model = rows.groupby("model")[column].mean().items()
    return {str(model): scale * float(mean) for model, mean in by_model}


def values(estimates: Estimates) -> Values:
    """The means of estimates."""
    return {name: estimate.mean for name, estimate in estimates.items()}


def mean_of(numbers: Values, models: Names) -> float:
    """The mean over the models that have a number; NaN if none has one."""
    present = [numbers[model] for model in models if model in numbers]
    return sum(present) / len(present) if present else np.nan


def improvements(immediate: pd.DataFrame, scope: str) -> Estimates:
    """Gain of each model over Xavier: 100 × (ratio of means over seeds − 1),
    averaged over sizes (section 6.1).
    """
    cells = where(immediate, scope=scope).pivot_table(
        "mrr_star", "seed", ["model", "size"], dropna=False
    )
    return relative(
        {
            str(model): (pd.DataFrame(cells[model]), pd.DataFrame(cells[BASELINE]))
            for model in cells.columns.unique("model")
            if BASELINE in cells
        }
    )


def relative(pairs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]], sign: int = 1) -> Estimates:
    """Per cent by which means over seeds (rows) exceed those of a reference,
    averaged over grid points (columns).

    ``pairs``: values and reference, by name. With ``sign`` -1: per cent below the reference. Nulls
    are left out.
    """
    estimates = {}
    for name, (cells, base) in pairs.items():
        if base.empty:
            continue
        values = [frame.to_numpy(float).T for frame in (cells.reindex(columns=base.columns), base)]
        with np.errstate(invalid="ignore"):  # a grid point without values gives NaN
            means = [
                (np.nansum(cell.T, axis=0) / (~np.isnan(cell)).sum(1))[:, None] for cell in values
            ]
            resampled = [
                _resampled(np.nan_to_num(cell)) / _resampled(~np.isnan(cell) * 1.0)
                for cell in values
            ]
            (mean,), shares = (
                100 * (sign * (over / under - 1)).T.mean(-1) for over, under in (means, resampled)
            )
        estimates[name] = Estimate(
            float(mean), *(_bounds(shares[None])[0].tolist() if len(base) > 1 else ())
        )
    return {name: estimate for name, estimate in estimates.items() if not np.isnan(estimate.mean)}


def epochs_summary(convergence: pd.DataFrame, by: Names) -> pd.DataFrame:
    """Epochs to convergence by group: mean, standard deviation, median,
    and per cent of runs without convergence.
    """
    means = over_seeds(convergence, by, {"epochs": "mean"}, scale=1)
    never = over_seeds(
        convergence.assign(lost=~convergence["converged"]), by, {"lost": "unconverged %"}
    )
    groups = convergence.groupby(list(by))["epochs"]
    middle = pd.DataFrame({"std": groups.std(ddof=1), "median": groups.median()})
    return pd.concat([means, middle, never], axis=1)


def by_label(models: Iterable[str], columns: Mapping[Any, Any], header: str = "model") -> Cells:
    """Columns of a table with a row for each model:
    its label, then its values in ``columns`` (None if it has none).
    """
    table: Cells = {header: list(map(label, models))}
    for column, of_model in columns.items():
        table[column] = [of_model.get(model) for model in models]
    return table


def by_group(frame: pd.DataFrame, groups: Iterable[Any], title: str = "{}") -> dict[Any, Any]:
    """Every column of ``frame`` for each group (first index level), titled by group;
    values by the other levels.
    """
    return {
        Column(str(name), title.format(group)): frame[name].get(group, {})
        for group in groups
        for name in frame
    }


def halves(runs: pd.DataFrame, *scopes: str) -> dict[Any, Any]:
    """For each scope, columns with the means of MRR* and its two halves, in points;
    values by model.
    """
    return by_group(over_seeds(runs, ["scope", "model"], HALVES), scopes)


def ordered_rows(
    means: pd.DataFrame, models: Names, header: Any = "model", **orders: Any
) -> pd.DataFrame:
    """Means by group as rows of a table, sorted by index level;
    ``orders``: values of a level to show, in order.
    """
    levels, frame = list(map(str, means.index.names)), means.reset_index()
    for name, order in {"model": models, **orders}.items():
        frame[name] = pd.Categorical(frame[name], list(order))
    frame = frame.dropna(subset=levels).sort_values(levels)
    frame["model"] = frame["model"].astype(object).map(label)
    return frame.rename(columns={"model": header, "scope": SCOPE})


def cells_of(rows: pd.DataFrame, models: Names, scope: str, column: str) -> pd.DataFrame:
    """Values of ``column`` in one scope: a row for each session, size and seed,
    a column for each model.
    """
    shown = where(rows, scope=scope)
    return shown.pivot(index=CELL, columns="model", values=column).reindex(columns=list(models))


def over_seeds(
    rows: pd.DataFrame, by: Names, columns: Mapping[str, str], scale: float = 100.0
) -> pd.DataFrame:
    """Means × ``scale`` of ``columns`` (name to new name) by group, with 95 % intervals over seeds;
    nulls left out.
    """
    if rows.empty:
        return pd.DataFrame(columns=[*by, *columns.values()], dtype=object).set_index(list(by))
    seeds = rows.groupby([*by, "seed"])[list(columns)]
    totals, numbers = seeds.sum().unstack("seed"), seeds.count().replace(0, np.nan).unstack("seed")
    estimates = {
        name: scale * ratios(totals[column].to_numpy(float), numbers[column].to_numpy(float))
        for column, name in columns.items()
    }
    return pd.DataFrame(
        {
            name: [Estimate(*value) for value in of_groups.tolist()]
            for name, of_groups in estimates.items()
        },
        index=totals.index,
    )


def by_model(rows: pd.DataFrame, column: str, models: Names, scale: float = 100.0) -> Estimates:
    """Mean × ``scale`` of a column, with its interval over seeds,
    for each of ``models`` that has rows, in order.
    """
    estimates = over_seeds(rows, ["model"], {column: "mean"}, scale)["mean"]
    return {model: estimates[model] for model in models if model in estimates.index}


def ratios(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """The sum of each row of ``over`` divided by that of ``under``,
    and its 95 % interval over seeds; shape: (rows, 3).

    Columns are seeds; those whose ``under`` is null are left out. The interval is the bootstrap's
    percentile interval, which is defined even where values are nearly constant (BCa is not). One
    seed alone has no interval.
    """
    estimates, present = np.full((len(over), 3), np.nan), ~np.isnan(under)
    for pattern in np.unique(present, axis=0):
        rows, seeds = (present == pattern).all(1), int(pattern.sum())
        upper, lower = over[rows][:, pattern], under[rows][:, pattern]
        if seeds:
            estimates[rows, 0] = upper.sum(1) / lower.sum(1)
        if seeds > 1:
            even = (lower == lower[:, :1]).all()  # every seed has the same number of values
            below = lower[:, :1] * seeds if even else _resampled(lower)
            estimates[rows, 1:] = _bounds(_resampled(upper) / below)
    return estimates


def _bounds(resampled: np.ndarray) -> np.ndarray:
    """The 2.5 % and the 97.5 % percentile of each row."""
    ranked: np.ndarray = np.sort(resampled, axis=1)  # faster than np.partition
    return ranked[:, [(RESAMPLES + 1) // 40 - 1, 39 * (RESAMPLES + 1) // 40 - 1]]


def _resampled(values: np.ndarray) -> np.ndarray:
    """Sums of each row over resamples of its columns (seeds): (rows, RESAMPLES). Not by BLAS:
    its threads cost more.
    """
    sums: np.ndarray = np.einsum(
        "rs,bs->rb", np.ascontiguousarray(values), resamples(values.shape[1])
    )
    return sums


@cache
def resamples(seeds: int) -> np.ndarray:
    """Count of each seed in each bootstrap resample, (RESAMPLES, seeds);
    it depends on ``seeds`` alone.
    """
    return (
        stream(0, "resamples", seeds)
        .multinomial(seeds, np.full(seeds, 1 / seeds), RESAMPLES)
        .astype(float)
    )


def combined(rows: pd.DataFrame, by: Names) -> pd.DataFrame:
    """MRR* of the queries of each group, with its halves, in [0, 1] (equation 7).

    The entity half is a mean over relations, weighted by observations, of the mean over a
    relation's head and tail queries. A half without queries is null; then MRR* is null. ``rows``:
    of ``QUERY_BREAKDOWN``.
    """
    weighted = rows.assign(total=rows["mrr_star"] * rows["queries"])
    of_relations = rows["hidden"] == "relation"
    groups = weighted[~of_relations].groupby(list(dict.fromkeys([*by, "relation"])), observed=True)
    sums, weight = groups[["total", "queries"]].sum(), groups["observations"].first()
    shares = pd.DataFrame({"mean": weight * sums["total"] / sums["queries"], "weight": weight})
    shares = shares.groupby(level=list(by)).sum()
    relations = weighted[of_relations].groupby(list(by), observed=True)[["total", "queries"]].sum()
    entity, relation = shares["mean"] / shares["weight"], relations["total"] / relations["queries"]
    halves = pd.DataFrame({"mrr_star_entity": entity, "mrr_star_relation": relation})
    halves["mrr_star"] = halves.mean(axis=1, skipna=False)
    return halves[list(HALVES)].reset_index()


def compare(measures: Mapping[str, pd.DataFrame], models: Names) -> list[Pair]:
    """Compare all pairs of models, ISI first; ``measures``: frames with a row per run,
    a column per model.
    """
    pairs, methods = [], isi(models)
    for measure, cells in measures.items():
        names = [
            sorted(pair, key=lambda name: name not in methods) for pair in combinations(models, 2)
        ]
        differences = [difference(by_seed(cells[first], cells[second])) for first, second in names]
        corrected = holm(np.array([points.p for points in differences])).tolist()
        pairs += [
            Pair(measure, first, second, points, p)
            for (first, second), points, p in zip(names, differences, corrected, strict=True)
        ]
    return pairs


def pairs_table(pairs: Iterable[Pair]) -> Rows:
    """Rows of a table: each pair with its interval and test; its p is "none" if no seed differs."""

    def form(p: float) -> str:
        return f"{p:.3f}" if p >= 0.001 else "< 0.001"

    return [
        {
            "measure": pair.measure,
            "first": label(pair.first),
            "second": label(pair.second),
            Column("difference", form=signed): (points := pair.difference),
        }
        | {
            Column(name, form=form, any_size=True): "none" if np.isnan(p) and points.seeds else p
            for name, p in (("p", points.p), ("p (Holm)", pair.holm))
        }
        | {"seeds": points.seeds, "of these differ": points.differing}
        for pair in pairs
    ]


def by_seed(first: pd.Series, second: pd.Series) -> np.ndarray:
    """First minus second, averaged by seed; rounded to 1e-9,
    so that ties do not depend on the order of sums.
    """
    means: pd.Series = (first - second).dropna().groupby("seed").mean()
    return means.to_numpy(float).round(9) + 0.0  # no -0


def difference(values: np.ndarray) -> Difference:
    """The mean of differences by seed, its interval over seeds, and the p of the sign-flip test."""
    if not len(values):
        return Difference(np.nan)
    mean, low, high = ratios(values[None], np.ones((1, len(values))))[0].tolist()
    return Difference(
        mean, low, high, sign_flip(values), len(values), int(np.count_nonzero(values))
    )


def sign_flip(values: np.ndarray) -> float:
    """The p of n differences: the share of the 2ⁿ choices of signs with |mean| at or
    above that of ``values``.

    Exact up to n = ``_COUNTED``: each signed sum of one half of the differences is looked up in the
    sorted sums of the other half, in integers of 1e-9, so that ties are exact. Differences of zero
    are dropped; NaN if none is left.
    """
    units = np.rint(np.abs(values[values != 0]) * 1e9).astype(np.int64)
    reached = abs(int(np.rint(values * 1e9).astype(np.int64).sum()))
    if not len(units):
        return np.nan
    if len(units) > _COUNTED:
        signs = stream(0, "signs").choice(np.array([-1, 1]), (_DRAWN, len(units)))
        return float(1 + (np.abs(signs @ units) >= reached).sum()) / (1 + _DRAWN)
    none, half = np.zeros(1, dtype=np.int64), len(units) // 2
    first, second = (
        np.sort(reduce(lambda sums, unit: np.append(sums - unit, sums + unit), part, none))
        for part in (units[:half], units[half:])
    )
    above = int((len(first) - np.searchsorted(first, reached - second)).sum())
    return 1.0 if not reached else 2.0 * above / 2 ** len(units)


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
