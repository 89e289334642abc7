"""Means over runs, in points of MRR*, and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np
import pandas as pd

from isi.evaluation.convergence import epochs_to_convergence
from isi.random import stream
from isi.report.models import BASELINE, label

HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity half", "mrr_star_relation": "relation half"}
#: Where the 95 % interval of a column ends: in columns of its own, which tables show with it.
LOW, HIGH = " low", " high"
RESAMPLES = 9_999
#: Scope by scope, each model's value.
ByScope = dict[str, dict[str, float]]


def mrr_star(runs: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Mean MRR* in points, of those that were asked anything."""
    return by_scope(100 * runs.groupby(["scope", "model"])["mrr_star"].mean().dropna(), models)


def epochs(convergence: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Mean epochs to convergence."""
    return by_scope(convergence.groupby(["scope", "model"])["epochs"].mean(), models)


def unconverged(convergence: pd.DataFrame, models: Sequence[str]) -> ByScope:
    """Share of runs that never converge, in per cent."""
    return by_scope(100 * (1 - convergence.groupby(["scope", "model"])["converged"].mean()), models)


def by_scope(values: pd.Series, models: Sequence[str]) -> ByScope:
    """Values by (scope, model) as mappings, models in their order."""
    return {
        str(scope): {model: float(values[scope, model]) for model in models if (scope, model) in values.index}
        for scope in values.index.unique("scope")
    }


def converged(
    runs: pd.DataFrame, joint: pd.DataFrame, margin: float, max_epochs: int, by: Sequence[str]
) -> pd.DataFrame:
    """``epochs_to_convergence`` session by session, each against the joint models in its own."""
    found = [
        epochs_to_convergence(own, joint[joint["session"] == session], margin, max_epochs, by).assign(session=session)
        for session, own in runs.groupby("session")
    ]
    columns = {**dict.fromkeys([*by, "scope", "size", "seed", "queries", "session"], object), "epochs": float}
    nothing = pd.DataFrame({name: pd.Series(dtype=kind) for name, kind in {**columns, "converged": bool}.items()})
    return pd.concat(found, ignore_index=True) if found else nothing


def collapsed(at_once: pd.DataFrame, ties: pd.DataFrame, entities: int) -> dict[str, float]:
    """Of models that give nearly everything the same score over all queries, how many rivals tie with an answer.

    A triple is asked for its head and for its tail; a model is taken for collapsed where, of both together, half as
    many rivals as there are entities have the answer's score.
    """
    tied, asked = ties[ties["scope"] == "all"], at_once[at_once["scope"] == "all"]
    rivals = tied.groupby("model")["ties"].sum() / asked.groupby("model")["queries"].sum().replace(0, np.nan)
    return {str(model): float(number) for model, number in rivals.items() if number >= entities / 2}


def improvement(at_once: pd.DataFrame, scope: str) -> dict[str, float]:
    """Of each model over Xavier, in per cent (see ``improvements``)."""
    return {str(model): float(value) for model, value in improvements(at_once, scope)["mean"].items()}


def improvements(at_once: pd.DataFrame, scope: str) -> pd.DataFrame:
    """Of each model over Xavier, in per cent: the ratio of means at each size, averaged over sizes (section 6.1).

    Returns:
        columns mean, low and high, by model; empty where Xavier was not run.
    """
    cells = at_once[at_once["scope"] == scope].pivot_table("mrr_star", "seed", ["model", "size"], dropna=False)
    if BASELINE not in cells:
        return pd.DataFrame(columns=["mean", "low", "high"], dtype=float)

    def gain(means: np.ndarray, baseline: np.ndarray) -> np.ndarray:
        over: np.ndarray = 100 * (means / baseline - 1).mean(-1)
        return over

    of_each = {
        str(model): pd.DataFrame(cells.xs(model, axis=1, level="model")) for model in cells.columns.unique("model")
    }
    base = of_each[BASELINE]
    found = {model: of_means(gain, own.reindex(columns=base.columns), base) for model, own in of_each.items()}
    return pd.DataFrame.from_dict(found, orient="index", columns=["mean", "low", "high"]).dropna(subset="mean")


def fewer_epochs(convergence: pd.DataFrame, scope: str = "all") -> dict[str, float]:
    """By how much each initializer's mean number of epochs is below Xavier's, in per cent (section 6.2)."""
    means = convergence[convergence["scope"] == scope].groupby("model")["epochs"].mean()
    if BASELINE not in means or not means[BASELINE]:
        return {}
    return {str(model): float(value) for model, value in (100 * (1 - means / means[BASELINE])).items()}


def halves_by_model(runs: pd.DataFrame, models: Sequence[str], scopes: Sequence[str]) -> pd.DataFrame:
    """A row for each model: mean MRR* in points with its entity and its relation half, scope by scope."""
    means = over_seeds(runs, ["model", "scope"], HALVES)
    frame = pd.DataFrame({"model": [label(model) for model in models]})
    for scope in scopes:
        own = means.xs(scope, level="scope") if scope in means.index.unique("scope") else means.head(0)
        for column in means.columns:
            frame[f"{scope}: {column}"] = own[column].reindex(list(models)).to_numpy()
    return frame


def halves_by_scope(runs: pd.DataFrame, models: Sequence[str], scopes: Sequence[str]) -> pd.DataFrame:
    """The same with a row for each scope and model."""
    means = over_seeds(runs[runs["scope"].isin(scopes)], ["scope", "model"], HALVES).reset_index()
    means["scope"] = means["scope"].astype(pd.CategoricalDtype(list(scopes), ordered=True))
    return in_order(means, ["scope", "model"], models).astype({"scope": str})


def in_order(frame: pd.DataFrame, by: Sequence[str], models: Sequence[str]) -> pd.DataFrame:
    """Rows sorted by columns, the last of which is ``model``: in the models' order, with their labels."""
    ordered = frame.assign(model=frame["model"].astype(pd.CategoricalDtype(list(models), ordered=True)))
    ordered = ordered.sort_values(list(by)).astype({"model": str})
    return ordered.assign(model=ordered["model"].map(label)).reset_index(drop=True)


def over_seeds(rows: pd.DataFrame, by: Sequence[str], columns: Mapping[str, str], scale: float = 100.0) -> pd.DataFrame:
    """Means of columns over the rows of each group, with 95 % intervals over seeds (see ``ratios``).

    Args:
        rows: with a column ``seed``; all that a seed has is resampled with it. Null values are left out.
        columns: to be averaged, and what they are called then.

    Returns:
        each column and where its interval ends (``LOW``, ``HIGH``), by group.
    """
    if rows.empty:
        ends = [f"{name}{end}" for name in columns.values() for end in ("", LOW, HIGH)]
        return pd.DataFrame(columns=[*by, *ends], dtype=float).set_index(list(by))
    seeds = rows.groupby([*by, "seed"])[list(columns)]
    totals, numbers = seeds.sum().unstack("seed"), seeds.count().unstack("seed")
    found: dict[str, np.ndarray] = {}
    for column, name in columns.items():
        count = numbers[column].to_numpy(float)
        values = scale * ratios(totals[column].to_numpy(float), np.where(count > 0, count, np.nan))
        found |= dict(zip((name, name + LOW, name + HIGH), values.T, strict=True))
    return pd.DataFrame(found, index=totals.index)


def ratios(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """Of each row, the sum of ``over`` by that of ``under``, and its 95 % interval over seeds; shape: (rows, 3).

    With numbers of values as ``under`` these are means. The interval is the bootstrap's, by percentiles:
    that method stays defined where values are nearly constant; BCa does not. Of one seed there is none.

    Args:
        over: a column a seed.
        under: likewise; a seed for which it is null takes no part.
    """
    found, present = np.full((len(over), 3), np.nan), ~np.isnan(under)
    for pattern in np.unique(present, axis=0):
        own, seeds = (present == pattern).all(1), int(pattern.sum())
        upper, lower = over[own][:, pattern], under[own][:, pattern]
        if seeds:
            found[own, 0] = upper.sum(1) / lower.sum(1)
        if seeds > 1:
            even = (lower == lower[:, :1]).all()  # as where every seed has as many values
            below = lower[:, :1] * seeds if even else _resampled(lower)
            found[own, 1:] = _ends(_resampled(upper) / below)
    return found


def _ends(drawn: np.ndarray) -> np.ndarray:
    """The 2.5 % and the 97.5 % percentile of each row."""
    ranked: np.ndarray = np.sort(drawn, axis=1)  # which is faster than to partition
    return ranked[:, [(RESAMPLES + 1) // 40 - 1, 39 * (RESAMPLES + 1) // 40 - 1]]


def _resampled(values: np.ndarray) -> np.ndarray:
    """Sums of rows over each resample of their columns, the seeds; shape: (rows, resamples).

    Without BLAS, whose threads cost more than they save on products this small.
    """
    sums: np.ndarray = np.einsum("rs,bs->rb", np.ascontiguousarray(values), resamples(values.shape[1]))
    return sums


def of_means(of: Callable[..., np.ndarray], *cells: pd.DataFrame) -> tuple[float, float, float]:
    """What a function makes of the means over seeds of each cell, and its 95 % interval over seeds.

    Args:
        of: of means, one for each frame: their last axis is the cells.
        cells: a row a seed and a column a cell, likewise in each; null values are left out.
    """

    if cells[0].empty:
        return np.nan, np.nan, np.nan
    values = [frame.to_numpy(float) for frame in cells]
    with np.errstate(invalid="ignore"):  # a cell without any value makes null
        value = float(of(*(np.nansum(own, axis=0) / (~np.isnan(own)).sum(0) for own in values)))
        means = [(_resampled(np.nan_to_num(own.T)) / _resampled(~np.isnan(own.T) * 1.0)).T for own in values]
        drawn = of(*means) if len(cells[0]) > 1 else np.array([])
    low, high = _ends(drawn[None])[0].tolist() if len(drawn) else (np.nan, np.nan)
    return value, low, high


@cache
def resamples(seeds: int) -> np.ndarray:
    """How often each resample of so many seeds has each of them; shape: (RESAMPLES, seeds).

    The same wherever so many are resampled, so that what is paired stays so.
    """
    drawn = stream(0, "resamples", seeds).multinomial(seeds, np.full(seeds, 1 / seeds), RESAMPLES)
    return drawn.astype(float)
