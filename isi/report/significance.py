"""Paired differences over seeds: how large they are, and whether chance could make them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from isi.random import stream
from isi.report.stats import ratios
from isi.report.tables import Column, Estimate
from isi.report.words import isi, label

#: A difference is significant where its corrected p is below this.
LEVEL = 0.05
#: A difference, as people read it.
signed = "{:+.2f}".format
#: Up to as many seeds that differ, every way to flip their signs is counted; beyond, as many ways are drawn.
_COUNTED, _DRAWN = 40, 99_999


@dataclass(frozen=True)
class Difference(Estimate):
    """How far two initializers are apart over seeds, and the p of the sign-flip test over those that differ."""

    p: float = np.nan
    seeds: int = 0
    differing: int = 0


@dataclass(frozen=True)
class Pair:
    """The difference of two initializers, first minus second, by one measure; ``holm``: its p, corrected within it."""

    measure: str
    first: str
    second: str
    difference: Difference
    holm: float

    @property
    def significant(self) -> bool:
        return self.holm < LEVEL


def compare(measures: Mapping[str, pd.DataFrame], models: Sequence[str]) -> list[Pair]:
    """Every pair of models, ISI first, by every measure, which has a column a model and a row a cell of a seed."""
    pairs, methods = [], isi(models)
    for measure, cells in measures.items():
        names = [sorted(pair, key=lambda name: name not in methods) for pair in combinations(models, 2)]
        differences = [difference(by_seed(cells[first], cells[second])) for first, second in names]
        corrected = holm(np.array([points.p for points in differences])).tolist()
        pairs += [Pair(measure, first, second, points, p)
                  for (first, second), points, p in zip(names, differences, corrected, strict=True)]  # fmt: skip
    return pairs


def pairs_table(pairs: Iterable[Pair]) -> list[dict[Any, Any]]:
    """Every pair with its interval and test; "none" stands for the p of a pair that no seed tells apart."""

    def form(p: float) -> str:
        return f"{p:.3f}" if p >= 0.001 else "< 0.001"

    return [
        {"measure": pair.measure, "first": label(pair.first), "second": label(pair.second),
         Column("difference", form=signed): (points := pair.difference)}
        | {Column(name, form=form, any_size=True): "none" if np.isnan(p) and points.seeds else p
           for name, p in (("p", points.p), ("p (Holm)", pair.holm))}
        | {"seeds": points.seeds, "of these differ": points.differing}
        for pair in pairs
    ]  # fmt: skip


def by_seed(first: pd.Series, second: pd.Series) -> np.ndarray:
    """First minus second where both have cells, by seed; rounded, so that the order of a sum breaks no tie."""
    means: pd.Series = (first - second).dropna().groupby("seed").mean()
    return means.to_numpy(float).round(9) + 0.0  # no -0


def difference(values: np.ndarray) -> Difference:
    """Of differences by seed: mean, interval over seeds, and the p of the sign-flip test."""
    if not len(values):
        return Difference(np.nan)
    mean, low, high = ratios(values[None], np.ones((1, len(values))))[0].tolist()
    return Difference(mean, low, high, sign_flip(values), len(values), int(np.count_nonzero(values)))


def sign_flip(values: np.ndarray) -> float:
    """The share of the 2ⁿ ways to give n differences a sign that make a mean at least as far from zero.

    Exact up to ``_COUNTED``: signed sums of one half of the differences count in the sorted ones of the other half, in
    whole billionths, so that ties are ties. Seeds that do not differ have no sign; null where none does.
    """
    units = np.rint(np.abs(values[values != 0]) * 1e9).astype(np.int64)
    reached = abs(int(np.rint(values * 1e9).astype(np.int64).sum()))
    if not len(units):
        return np.nan
    if len(units) > _COUNTED:
        signs = stream(0, "signs").choice(np.array([-1, 1]), (_DRAWN, len(units)))
        return float(1 + (np.abs(signs @ units) >= reached).sum()) / (1 + _DRAWN)
    none, half = np.zeros(1, dtype=np.int64), len(units) // 2
    first, second = (np.sort(reduce(lambda sums, unit: np.append(sums - unit, sums + unit), part, none))
                     for part in (units[:half], units[half:]))  # fmt: skip
    above = int((len(first) - np.searchsorted(first, reached - second)).sum())
    return 1.0 if not reached else 2.0 * above / 2 ** len(units)


def holm(p: np.ndarray) -> np.ndarray:
    """Holm's step-down correction: the i-th smallest of m times (m − i + 1), never falling, at most 1.

    Null, where there is nothing to test, counts as a p of 1 among the m and stays null.
    """
    known = np.nan_to_num(p, nan=1.0)
    order = known.argsort(kind="stable")
    corrected = np.empty(len(p))
    corrected[order] = np.maximum.accumulate(known[order] * np.arange(len(p), 0, -1)).clip(max=1)
    return np.where(np.isnan(p), np.nan, corrected)
