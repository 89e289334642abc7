"""What the paper states of its runs, computed from ours, each with its 95 % interval over sets of
novel entities (sections 6.1 to 6.3).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from isi.random import stream
from stages.report.tables.estimates import BASELINE, Estimate, jackknife, means_without_each, where

#: Samples of sets, drawn with replacement, from which the interval of a best number comes.
SAMPLES = 2000
#: Quantiles of these samples.
INTERVAL = (0.025, 0.975)
ISI = "isi"  #: The mean over ES, RS and ERS.
#: The paper's initializers, and all that it compares but Xavier.
METHODS = ["es", "rs", "ers"]
OTHERS = ["iu", *METHODS]
#: The share of the known entities' group, by which section 6.3's ten values agree with each other.
PAPERS_SHARE = 0.75


@dataclass(frozen=True, eq=False)
class Statistics:
    """Runs of one experiment. Arrays have S + 1 rows: of all seeds, and without each of them."""

    immediate: pd.DataFrame  #: right after insertion: model, scope, size, seed and value, in points
    epochs: pd.DataFrame  #: to convergence: model, size, seed, epochs and converged

    @cached_property
    def ended(self) -> "Statistics":
        """These statistics of the runs that converge alone: the second form of a mean of epochs."""
        return Statistics(self.immediate, self.epochs[self.epochs["converged"]])

    def weighted(self, model: str) -> Estimate:
        """The mean over both groups, by the share of each (section 6.1)."""
        return jackknife(self._mean(model))

    def by_papers_share(self, model: str) -> Estimate:
        """The mean over both groups, by the share of the known in the paper's own values."""
        known, novel = (self._mean(model, group) for group in ("known", "novel"))
        return jackknife(PAPERS_SHARE * known + (1 - PAPERS_SHARE) * novel)

    def novel(self, model: str) -> Estimate:
        """The mean about novel entities."""
        return jackknife(self._mean(model, "novel"))

    def known(self, model: str) -> Estimate:
        """The mean about known entities."""
        return jackknife(self._mean(model, "known"))

    def gain(self, model: str) -> Estimate:
        """Per cent by which the mean over sizes exceeds Xavier's (section 6.1)."""
        return jackknife(100 * (self._mean(model) / self._mean(BASELINE) - 1))

    def gain_by_size(self, model: str) -> Estimate:
        """Per cent by which the mean of each size exceeds Xavier's, then the mean over sizes."""
        ratios = self._by_size(model) / self._by_size(BASELINE)
        return jackknife(100 * (_over_sizes(ratios) - 1))

    def drop(self, model: str) -> Estimate:
        """Per cent by which the mean about known entities is below that of the paper's other four
        initializers (section 6.3).
        """
        others = np.mean([self._mean(other, "known") for other in OTHERS], axis=0)
        return jackknife(100 * (1 - self._mean(model, "known") / others))

    def mean_epochs(self, model: str) -> Estimate:
        """Mean epochs to convergence over runs (Table 2)."""
        return jackknife(self._epochs(model), least=0)

    def deviation(self, model: str) -> Estimate:
        """Standard deviation of the epochs to convergence over runs (Table 2)."""
        squares, means = self._epochs(model, power=2), self._epochs(model)
        number = int((self.epochs["model"] == model).sum())
        variance = (squares - means**2).clip(min=0) * number / max(number - 1, 1)
        return jackknife(np.sqrt(variance), least=0)

    def fewer_epochs(self, model: str) -> Estimate:
        """Per cent by which mean epochs are below Xavier's (section 6.2); ``ISI``: the mean over
        ES, RS and ERS (abstract).
        """
        models = METHODS if model == ISI else [model]
        shares = [1 - self._epochs(each) / self._epochs(BASELINE) for each in models]
        return jackknife(100 * np.mean(shares, axis=0))

    def _by_size(self, model: str, scope: str = "weighted") -> np.ndarray:
        """Means over seeds; shape (1 + S, sizes)."""
        rows = where(self.immediate, scope=scope)
        return means_without_each(by_seed_and_size(rows, model, "value"))

    def _mean(self, model: str, scope: str = "weighted") -> np.ndarray:
        """Means over seeds and sizes; shape (1 + S,)."""
        return _over_sizes(self._by_size(model, scope))

    def _epochs(self, model: str, power: int = 1) -> np.ndarray:
        """Mean epochs over all runs, or of a power of them; shape (1 + S,)."""
        cells = by_seed_and_size(self.epochs, model, "epochs") ** power
        return means_without_each(cells, pooled=True)


def _over_sizes(means: np.ndarray) -> np.ndarray:
    """Means over sizes, the columns; null without any."""
    return means.mean(axis=1) if means.size else np.full(len(means), np.nan)


def by_seed_and_size(rows: pd.DataFrame, model: str, column: str) -> pd.DataFrame:
    """The values of a model: a row for each seed and a column for each size of any model; null
    where it has none.
    """
    seeds, sizes = (sorted(set(rows[name])) for name in ("seed", "size"))
    of_model = where(rows, model=model).pivot(index="seed", columns="size", values=column)
    return of_model.reindex(index=seeds, columns=sizes).astype(float)


def best_indicators(sweep: pd.DataFrame) -> Estimate:
    """The number k of indicators with the highest mean value over seeds, and where the middle 95 %
    of it lies in samples of seeds; rows: k, seed and value.
    """
    cells = sweep.pivot(index="seed", columns="k", values="value")
    values, numbers = cells.to_numpy(float), cells.columns.to_numpy(float)
    seeds = len(values)
    draws = stream(0, "sets of indicators in the report").multinomial(
        seeds, np.full(seeds, 1 / seeds), SAMPLES
    )
    weights = np.vstack([np.ones(seeds), draws])
    present = ~np.isnan(values)
    means = (weights @ np.where(present, values, 0.0)) / (weights @ present)
    best = numbers[np.nan_to_num(means).argmax(axis=1)]
    low, high = np.quantile(best[1:], INTERVAL, method="inverted_cdf")
    return float(best[0]), float(low), float(high)


def right_after(sweep: pd.DataFrame, model: str) -> pd.DataFrame:
    """The weighted measure of a swept initializer right after insertion: k, seed and value."""
    rows = where(sweep, model=model, scope="weighted", epoch=0)
    return rows.assign(value=100 * rows["mrr"])[["k", "seed", "value"]]
