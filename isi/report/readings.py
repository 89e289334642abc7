"""The paper's results under every reading of its metric:
values with intervals, and the reading that fits them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, nan, sqrt
from typing import Any, Self, cast

import numpy as np
import pandas as pd

from isi.analyses.readings import READING_CURVES, READINGS, ReadingCase
from isi.evaluation.readings import CHOICES, Reading, place_of, readings
from isi.report import stats
from isi.report.tables import Estimate
from isi.report.words import BASELINE, JOINT, isi

#: Resamples of the seeds for the interval of a result.
RESAMPLES = 1_999
#: A distance in half-widths counts at most this much; also where a reading gives no value.
FAR = 10.0
#: Half of the last digit that the paper prints.
PRINTED = 0.05
#: The product's reading, that of the report: ``mrr_star`` in scope ``all``.
OURS = Reading()


@dataclass(frozen=True, eq=False)
class CaseRuns:
    """The measures of a case under every reading."""

    case: ReadingCase
    #: MRR* (points) right after insertion, by model, number of indicators and size; shape:
    #: (seeds, readings)
    mrr_star: Mapping[tuple[str, int, int], np.ndarray]
    #: the same for epochs to convergence, of sizes fine-tuned; infinite where a run ended before
    #: that was decided
    epochs: Mapping[tuple[str, int, int], np.ndarray]
    curves: Mapping[str, np.ndarray]  #: ``READING_CURVES``

    @classmethod
    def read(cls, name: str, case: ReadingCase) -> Self:
        """The tables of a case."""
        frame = READINGS.read(case=name)
        place = np.zeros(len(frame), np.int64)
        for aspect, choices in CHOICES.items():
            codes = pd.Categorical(frame[aspect], categories=choices).codes
            place = place * len(choices) + codes
        frame = frame.assign(place=place)
        mrr_star, epochs = dict[Any, np.ndarray](), dict[Any, np.ndarray]()
        for key, rows in frame.groupby(["model", "k", "size"], observed=True):
            model, k, size = cast("tuple[str, int, int]", key)
            ordered, shape = rows.sort_values(["seed", "place"]), (rows["seed"].nunique(), -1)
            mrr_star[model, k, size] = 100 * ordered["mrr_star"].to_numpy(float).reshape(shape)
            if size in case.finetuned and model != JOINT:
                undecided = ordered["epochs"].isna() & ordered["mrr_star"].notna()
                number = ordered["epochs"].mask(undecided, inf)
                epochs[model, k, size] = number.to_numpy(float).reshape(shape)
        tensors = READING_CURVES.read_file(READING_CURVES.path(case=name))
        return cls(case, mrr_star, epochs, {key: tensor.numpy() for key, tensor in tensors.items()})

    @property
    def seeds(self) -> int:
        return self.case.sessions.seeds

    @property
    def sizes(self) -> list[int]:
        return sorted(self.case.sessions.sizes)

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.case.initializers, JOINT]

    def swept(self, model: str) -> list[int]:
        """The numbers of indicators of a sweep."""
        return self.case.indicators.get(model, [])


#: The runs of a case, the places of N readings in ``readings()``, and weights of the seeds, (B, S),
#: that sum to 1, to a number under each reading; shape: (B, N).
Measured = Callable[[CaseRuns, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class PaperResult:
    """A result that the paper prints: its value, and how it is measured on a case."""

    place: str  #: in the paper
    title: str
    paper: float
    case: str
    measured: Measured
    about: str = ""  #: replaces the reading's, where the paper says whom the queries are about
    group: str = ""  #: results whose order the paper shows


def _means(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted means over the seeds with a value; values: (S, N); weights: (B, S);
    shape: (B, N).
    """
    present = ~np.isnan(values)
    total = np.einsum("bs,sn->bn", weights, np.where(present, values, 0.0))
    share = np.einsum("bs,sn->bn", weights, present.astype(float))
    with np.errstate(invalid="ignore", divide="ignore"):  # a reading without queries has no mean
        means: np.ndarray = total / share
    return means


def _over_sizes(values: Sequence[np.ndarray]) -> np.ndarray:
    mean: np.ndarray = np.mean(np.stack(values), axis=0)
    return mean


def gain(model: str) -> Measured:
    """Per cent by which mean MRR* exceeds Xavier's, averaged over sizes (section 6.1)."""

    def measured(runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        ratios = []
        for size in runs.sizes:
            of_model, base = (runs.mrr_star[name, 0, size][:, places] for name in (model, BASELINE))
            ratios.append(100 * (_means(of_model, weights) / _means(base, weights) - 1))
        return _over_sizes(ratios)

    return measured


def mrr_star(model: str) -> Measured:
    """Mean MRR* right after insertion, over all sizes."""

    def measured(runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        means = [_means(runs.mrr_star[model, 0, size][:, places], weights) for size in runs.sizes]
        return _over_sizes(means)

    return measured


def drop(model: str) -> Measured:
    """Per cent by which mean MRR* is below the joint model's (section 6.3)."""

    def measured(runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        of_model, of_joint = (mrr_star(name)(runs, places, weights) for name in (model, JOINT))
        below: np.ndarray = 100 * (1 - of_model / of_joint)
        return below

    return measured


def epochs(model: str, statistic: str = "mean") -> Measured:
    """Mean or standard deviation of the epochs to convergence over sizes and seeds (Table 2)."""

    def measured(runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        sizes = [runs.epochs[model, 0, size][:, places] for size in sorted(runs.case.finetuned)]
        if not sizes:
            return np.full((len(weights), len(places)), nan)
        mean = _over_sizes([_means(of_size, weights) for of_size in sizes])
        if statistic == "mean":
            return mean
        square = _over_sizes([_means(of_size**2, weights) for of_size in sizes])
        number = len(sizes) * runs.seeds
        variance = np.where(np.isinf(mean), inf, square - np.where(np.isinf(mean), 0.0, mean) ** 2)
        deviation: np.ndarray = np.sqrt(variance.clip(min=0) * (number / (number - 1)))
        return deviation

    return measured


def best_indicators(model: str) -> Measured:
    """The number of indicators with the highest mean MRR* right after insertion,
    at the first size (Figure 2a).
    """

    def measured(runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        size, numbers = runs.sizes[0], runs.swept(model)
        means = np.stack(
            [_means(runs.mrr_star[model, k, size][:, places], weights) for k in numbers]
        )
        best = np.array(numbers, float)[np.nan_to_num(means).argmax(0)]
        return np.where(np.isnan(means).all(0), nan, best)

    return measured


def results_of(paper: Mapping[str, Any]) -> list[PaperResult]:
    """The results of the paper that a reading decides,
    from its numbers (``data/raw/paper/values.yaml``).
    """
    gains, moved, listed = (
        paper["immediate"]["improvement_over_xavier"],
        paper["transfer"],
        list[PaperResult](),
    )
    for name, value in gains.items():
        listed.append(
            PaperResult(
                "section 6.1", f"gain of {name}", value, "published", gain(name), "", "gain"
            )
        )
    for name, number in paper["convergence"]["epochs"].items():
        listed.append(
            PaperResult(
                "Table 2",
                f"epochs of {name}",
                number["mean"],
                "published",
                epochs(name),
                "",
                "epochs",
            )
        )
    for name, number in paper["convergence"]["epochs"].items():
        deviation = number["deviation"]
        title = f"deviation of the epochs of {name}"
        listed.append(
            PaperResult(
                "Table 2", title, deviation, "published", epochs(name, "deviation"), "", "deviation"
            )
        )
    for key, about, group in (("all_queries", "", "all"), ("novel_queries", "novel", "novel")):
        of_whom = "all queries" if key == "all_queries" else "new entities"
        for name, value in moved[key].items():
            title = f"{of_whom}: {name}"
            listed.append(
                PaperResult("section 6.3", title, value, "extended", mrr_star(name), about, group)
            )
    for name, value in moved["drop"].items():
        title = f"AI2-THOR's entities: {name} below the joint model"
        listed.append(PaperResult("section 6.3", title, value, "extended", drop(name), "known"))
    base = moved["epochs"][BASELINE]
    listed.append(
        PaperResult(
            "section 6.3",
            f"epochs after the transfer, {BASELINE}",
            base,
            "extended",
            epochs(BASELINE),
        )
    )
    for name in isi(gains):
        best = paper["indicators_degrade_after"]
        title = f"best number of indicators of {name}"
        listed.append(PaperResult("Figure 2a", title, best, "sweep", best_indicators(name)))
    return listed


@dataclass(frozen=True, eq=False)
class Fit:
    """Every result under every reading, and how far each is from the paper."""

    results: Sequence[PaperResult]
    values: np.ndarray  #: shape: (results, readings)
    #: bounds of the interval in which 95 % of means over the paper's repeats would lie
    low: np.ndarray
    high: np.ndarray
    paper: np.ndarray  #: shape: (results, 1)

    @classmethod
    def of(
        cls, results: Sequence[PaperResult], cases: Mapping[str, CaseRuns], repeats: int
    ) -> Self:
        """Measure each result on its case; ``repeats``: the paper's seeds."""
        parts = [_interval(result, cases[result.case], repeats) for result in results]
        values, low, high = (np.stack(part) for part in zip(*parts, strict=True))
        return cls(results, values, low, high, np.array([[result.paper] for result in results]))

    @cached_property
    def distance(self) -> np.ndarray:
        """How far each value is from the paper's, in half-widths of its interval, at most ``FAR``;
        as ``values``.
        """
        side = np.where(self.paper >= self.values, self.high - self.values, self.values - self.low)
        apart = np.abs(self.paper - self.values) / np.maximum(side, PRINTED)
        distance: np.ndarray = np.nan_to_num(apart, nan=FAR).clip(max=FAR)
        return distance

    @property
    def within(self) -> np.ndarray:
        """Whether the paper's value lies in the interval; as ``values``."""
        lies: np.ndarray = self.distance <= 1
        return lies

    def order(self, rows: Sequence[int] | slice = slice(None)) -> list[int]:
        """Places of the readings by mean distance over some of the results, the nearest first."""
        means = self.distance[rows].mean(0)
        return [int(place) for place in np.lexsort((np.arange(len(means)), means.round(9)))]

    def estimate(self, row: int, place: int) -> Estimate:
        """A result under a reading, with its interval."""
        return Estimate(*(float(part[row, place]) for part in (self.values, self.low, self.high)))


def _interval(
    result: PaperResult, runs: CaseRuns, repeats: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A result under every reading, and its interval for a mean over the paper's repeats;
    shapes: (readings,).

    The bootstrap's percentile interval is that of our mean over S seeds. A mean over other R seeds
    differs from it by √(1 + S / R) times as much.
    """
    places = np.array([place_of(about(reading, result.about)) for reading in readings()])
    distinct, back = np.unique(places, return_inverse=True)
    even = np.full((1, runs.seeds), 1 / runs.seeds)
    values = result.measured(runs, distinct, even)[0]
    resampled = result.measured(
        runs, distinct, stats.resamples(runs.seeds)[:RESAMPLES] / runs.seeds
    )
    measured = np.isfinite(values)
    resampled = np.where(np.isfinite(resampled), resampled, np.nan_to_num(values, posinf=0.0))
    low, high = np.percentile(resampled, (2.5, 97.5), axis=0)
    values, low, high = (np.where(measured, part, nan) for part in (values, low, high))
    wider = sqrt(1 + runs.seeds / repeats)
    return (
        values[back],
        (values - wider * (values - low))[back],
        (values + wider * (high - values))[back],
    )


def about(reading: Reading, whom: str) -> Reading:
    """The reading with ``about`` replaced; as it is, if ``whom`` is empty."""
    return replace(reading, about=whom) if whom else reading
