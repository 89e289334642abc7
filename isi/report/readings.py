"""The paper's results under every reading of its metric:
values with intervals, and the reading that fits them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from isi.report.words import BASELINE, JOINT, isi, label

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


def read(cases: Mapping[str, ReadingCase]) -> dict[str, CaseRuns]:
    """The cases that were run."""
    return {
        name: CaseRuns.read(name, case)
        for name, case in cases.items()
        if READINGS.path(case=name).exists()
    }


@dataclass(frozen=True, eq=False)
class Weighted:
    """The runs of a case under N readings, with B weightings of its S seeds."""

    runs: CaseRuns
    places: np.ndarray  #: of the readings in ``readings()``; shape: (N,)
    weights: np.ndarray  #: each row sums to 1; shape: (B, S)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means over the seeds with a value; ``values``: (S, readings); shape: (B, N)."""
        shown = values[:, self.places]
        present = ~np.isnan(shown)
        total = np.einsum("bs,sn->bn", self.weights, np.where(present, shown, 0.0))
        share = np.einsum("bs,sn->bn", self.weights, present.astype(float))
        with np.errstate(invalid="ignore", divide="ignore"):  # a reading without queries
            means: np.ndarray = total / share
        return means

    def by_size(self, model: str) -> np.ndarray:
        """Mean MRR* right after insertion; shape: (sizes, B, N)."""
        sizes = [self.mean(self.runs.mrr_star[model, 0, size]) for size in self.runs.sizes]
        return np.stack(sizes)


#: A number of a model under each reading; shape: (B, N).
Measure = Callable[[Weighted, str], np.ndarray]


@dataclass(frozen=True)
class PaperResult:
    """A result that the paper prints: its value, and how it is measured on a case."""

    place: str  #: in the paper
    title: str
    paper: float
    case: str
    measure: Measure
    model: str
    about: str = ""  #: replaces the reading's, where the paper says whom the queries are about
    group: str = ""  #: results whose order the paper shows

    def measured(self, runs: CaseRuns, places: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return self.measure(Weighted(runs, places, weights), self.model)


def gain(of: Weighted, model: str) -> np.ndarray:
    """Per cent by which mean MRR* exceeds Xavier's, averaged over sizes (section 6.1)."""
    ratios: np.ndarray = of.by_size(model) / of.by_size(BASELINE)
    return np.asarray((100 * (ratios - 1)).mean(0))


def mrr_star(of: Weighted, model: str) -> np.ndarray:
    """Mean MRR* right after insertion, over all sizes."""
    return np.asarray(of.by_size(model).mean(0))


def drop(of: Weighted, model: str) -> np.ndarray:
    """Per cent by which mean MRR* is below the joint model's (section 6.3)."""
    return np.asarray(100 * (1 - mrr_star(of, model) / mrr_star(of, JOINT)))


def epochs(of: Weighted, model: str, power: int = 1) -> np.ndarray:
    """Mean epochs to convergence, or of their squares, over sizes and seeds (Table 2)."""
    sizes = [of.runs.epochs[model, 0, size] ** power for size in sorted(of.runs.case.finetuned)]
    if not sizes:
        return np.full((len(of.weights), len(of.places)), nan)
    return np.asarray(np.mean([of.mean(size) for size in sizes], axis=0))


def deviation(of: Weighted, model: str) -> np.ndarray:
    """Standard deviation of the epochs to convergence over sizes and seeds (Table 2)."""
    mean, square = epochs(of, model), epochs(of, model, power=2)
    number = len(of.runs.case.finetuned) * of.runs.seeds
    variance = np.where(np.isinf(mean), inf, square - np.where(np.isinf(mean), 0.0, mean) ** 2)
    return np.sqrt(variance.clip(min=0) * (number / (number - 1)))


def best_indicators(of: Weighted, model: str) -> np.ndarray:
    """The number of indicators with the highest mean MRR* right after insertion,
    at the first size (Figure 2a).
    """
    size, numbers = of.runs.sizes[0], of.runs.case.indicators[model]
    means = np.stack([of.mean(of.runs.mrr_star[model, k, size]) for k in numbers])
    best = np.array(numbers, float)[np.nan_to_num(means).argmax(0)]
    return np.where(np.isnan(means).all(0), nan, best)


def results_of(paper: Mapping[str, Any]) -> Iterator[PaperResult]:
    """The results of the paper that a reading decides,
    from its numbers (``data/raw/paper/values.yaml``).
    """
    gains, moved = paper["immediate"]["improvement_over_xavier"], paper["transfer"]
    table2 = paper["convergence"]["epochs"]

    def result(title: str, value: float, measure: Measure, name: str, group: str) -> PaperResult:
        place = "section 6.1" if group == "gain" else "Table 2"
        return PaperResult(
            place, f"{title} {label(name)}", value, "published", measure, name, group=group
        )

    def transferred(title: str, value: float, measure: Measure, name: str, *of: str) -> PaperResult:
        return PaperResult("section 6.3", title, value, "extended", measure, name, *of)

    for name, value in gains.items():
        yield result("gain of", value, gain, name, "gain")
    for name, number in table2.items():
        yield result("epochs of", number["mean"], epochs, name, "epochs")
    for name, number in table2.items():
        title = "deviation of the epochs of"
        yield result(title, number["deviation"], deviation, name, "deviation")
    for name, value in moved["all_queries"].items():
        yield transferred(f"all queries: {label(name)}", value, mrr_star, name, "", "all")
    for name, value in moved["novel_queries"].items():
        title = f"new entities: {label(name)}"
        yield transferred(title, value, mrr_star, name, "novel", "novel")
    for name, value in moved["drop"].items():
        title = f"AI2-THOR's entities: {label(name)} below the joint model"
        yield transferred(title, value, drop, name, "known")
    title = f"epochs after the transfer, {label(BASELINE)}"
    yield transferred(title, moved["epochs"][BASELINE], epochs, BASELINE)
    for name in isi(gains):
        title = f"best number of indicators of {label(name)}"
        best = paper["indicators_degrade_after"]
        yield PaperResult("Figure 2a", title, best, "sweep", best_indicators, name)


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
        return np.asarray(np.nan_to_num(apart, nan=FAR).clip(max=FAR))

    @property
    def within(self) -> np.ndarray:
        """Whether the paper's value lies in the interval; as ``values``."""
        return np.asarray(self.distance <= 1)

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
