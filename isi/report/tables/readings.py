"""The paper's results measured under every reading of its metric, and which reading fits them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import nan, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from isi import config
from isi.config import value_of
from isi.report.tables.data import BASELINE, JOINT, Models, read
from isi.report.tables.estimates import over_seeds, where
from isi.tables import paths

if TYPE_CHECKING:
    from isi.analyses.readings import ReadingCase
    from isi.params import Params

#: What allows the choices of a reading, readings of ``on_each_graph``, and the results of the
#: paper.
ABOUT = config.read(Path(__file__).with_name("readings.yaml"))
#: Choices by aspect, in the order of ``isi.evaluation.readings``.
TITLES: dict[str, dict[str, str]] = ABOUT["titles"]
#: Every reading by its name: its choices in order.
READINGS = [" ".join(choices) for choices in product(*TITLES.values())]
#: The product's reading, that of the report.
OURS: str = ABOUT["shown"]["this project's"]
#: A distance in half-widths counts at most this much; also where a reading gives no value.
FAR = 10.0
#: Half of the last digit that the paper prints.
PRINTED = 0.05
MAIN = "published"  #: The case without which there are no tables.


def changed(reading: str, **choices: str) -> str:
    """A reading with other choices of some aspects."""
    names = dict(zip(TITLES, reading.split(), strict=True)) | choices
    return " ".join(names.values())


def allowed(reading: str, *by: str) -> bool:
    """Whether each choice of a reading is allowed by the ``paper`` or by the ``program``."""
    return all(
        any(choice in ABOUT[who].get(aspect, {}) for who in by)
        for aspect, choice in zip(TITLES, reading.split(), strict=True)
    )


#: Readings that the paper's words or its authors' program allow, and of these those that the
#: paper's words do.
ALLOWED = [reading for reading in READINGS if allowed(reading, "paper", "program")]
IN_WORDS = [reading for reading in READINGS if allowed(reading, "paper")]


@dataclass(frozen=True, eq=False)
class CaseRuns:
    """The measures of a case: rows by model, number of indicators, size and seed, a column for each
    reading.
    """

    case: "ReadingCase | Any"
    mrr_star: pd.DataFrame  #: points, right after insertion
    epochs: pd.DataFrame  #: to convergence, of the runs that are fine-tuned
    sizes: list[int]
    finetuned: list[int]  #: of these, sizes that are fine-tuned

    @classmethod
    def of(cls, case: "ReadingCase | Any", rows: pd.DataFrame) -> Self:
        """From the table of a case, with a column for each aspect of a reading."""
        first, *others = TITLES
        rows = rows.assign(reading=rows[first].str.cat(rows[others], sep=" "))
        index = ["model", "k", "size", "seed"]
        mrr_star = 100 * rows.pivot(index=index, columns="reading", values="mrr_star")[READINGS]
        epochs = rows.pivot(index=index, columns="reading", values="epochs")[READINGS]
        epochs = epochs.dropna(how="all")
        return cls(case, mrr_star, epochs, sorted(case.sessions.sizes), sorted(case.finetuned))

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.case.initializers, *self.case.controls, JOINT]

    def at(self, others: Sequence["CaseRuns"]) -> "CaseRuns":
        """The measures at the sizes that others have, too."""
        sizes = set(self.sizes).intersection(*(other.sizes for other in others))
        finetuned = set(self.finetuned).intersection(*(other.finetuned for other in others))
        return replace(self, sizes=sorted(sizes), finetuned=sorted(finetuned))


def means_of(measured: pd.DataFrame, reading: str) -> pd.DataFrame:
    """Means over sizes and seeds under a reading, by model, with intervals."""
    rows = measured[reading].rename("mean").reset_index()
    return over_seeds(where(rows, k=0), ["model"], {"mean": "mean"}, scale=1)


@dataclass(frozen=True, eq=False)
class Measured:
    """The runs of a case with S seeds under N readings, weighted in 1 + S ways: all seeds alike,
    and without each of them.

    The methods by names of ``readings.yaml`` measure one model; shape: (3, N), ``estimate``.
    """

    runs: CaseRuns
    readings: Sequence[str]
    repeats: int  #: the paper's seeds

    def mean(self, frame: pd.DataFrame, *place: Any) -> np.ndarray:
        """Means over the seeds with a value at a model, number of indicators and size; shape:
        (1 + S, N).
        """
        values = frame.loc[place, self.readings].to_numpy(float)
        weights = np.vstack([np.ones(len(values)), 1 - np.eye(len(values))])
        present = ~np.isnan(values)
        with np.errstate(invalid="ignore", divide="ignore"):  # no queries
            means: np.ndarray = weights @ np.where(present, values, 0.0) / (weights @ present)
        return means

    def estimate(self, values: np.ndarray) -> np.ndarray:
        """A value, and the bounds in which 95 % of such values over the paper's repeats would lie;
        ``values``: (..., 1 + S, N); shape: (3, ..., N).

        Student's t with the error of the jackknife, which is the usual one for a mean. A mean over
        other R seeds differs from ours by √(1 + S / R) times as much as ours from the true one.
        """
        value, others = values[..., 0, :], values[..., 1:, :]
        seeds = others.shape[-2]
        with np.errstate(invalid="ignore"):
            error = others.std(-2) * sqrt(seeds - 1)
        around = stdtrit(seeds - 1, 0.975) * sqrt(1 + seeds / self.repeats) * error
        parts = np.stack([value, value - around, value + around])
        return np.where(np.isfinite(value), parts, nan)

    def _by_size(self, model: str) -> np.ndarray:
        """Mean MRR* right after insertion; shape: (sizes, 1 + S, N)."""
        means = [self.mean(self.runs.mrr_star, model, 0, size) for size in self.runs.sizes]
        return np.stack(means)

    def gain(self, model: str) -> np.ndarray:
        """Per cent by which mean MRR* exceeds Xavier's, averaged over sizes (section 6.1)."""
        ratios = self._by_size(model) / self._by_size(BASELINE)
        return self.estimate(100 * (ratios - 1).mean(0))

    def mrr_star(self, model: str) -> np.ndarray:
        """Mean MRR* right after insertion, over all sizes."""
        return self.estimate(self._by_size(model).mean(0))

    def drop(self, model: str) -> np.ndarray:
        """Per cent by which mean MRR* is below the joint model's (section 6.3)."""
        ratio = self._by_size(model).mean(0) / self._by_size(JOINT).mean(0)
        return self.estimate(100 * (1 - ratio))

    def _epochs(self, model: str, power: int) -> np.ndarray:
        """Mean epochs to convergence, or of their squares, over sizes; shape: (1 + S, N)."""
        powers = self.runs.epochs**power
        means = [self.mean(powers, model, 0, size) for size in self.runs.finetuned]
        return np.asarray(np.stack(means).mean(0))

    def epochs(self, model: str) -> np.ndarray:
        """Mean epochs to convergence over sizes and seeds (Table 2)."""
        return self.estimate(self._epochs(model, 1))

    def deviation(self, model: str) -> np.ndarray:
        """Standard deviation of the epochs to convergence over sizes and seeds (Table 2)."""
        means = self._epochs(model, 1)
        number = len(self.runs.finetuned) * (len(means) - 1)
        variance = self._epochs(model, 2) - means**2
        return self.estimate(np.sqrt(variance.clip(min=0) * number / (number - 1)))

    def best_indicators(self, model: str) -> np.ndarray:
        """The number of indicators with the highest mean MRR* right after insertion, at the first
        size (Figure 2a), and the least and the largest number that is not significantly worse.
        """
        numbers = self.runs.case.indicators[model]
        measured, size = self.runs.mrr_star, self.runs.sizes[0]
        means = np.stack([self.mean(measured, model, k, size) for k in numbers])
        best = np.nan_to_num(means[:, 0]).argmax(0)
        _, worse, _ = self.estimate(np.take_along_axis(means, best[None, None], 0) - means)
        column = np.array(numbers, float)[:, None]
        alike = np.where(worse <= 0, column, nan)
        return np.stack([column[best, 0], np.fmin.reduce(alike), np.fmax.reduce(alike)])


@dataclass(frozen=True)
class PaperResult:
    """A result that the paper prints: its value, and how it is measured on a case."""

    kind: str
    place: str  #: in the paper
    title: str
    model: str
    paper: float
    case: str
    measure: str  #: the name of a method of ``Measured``
    about: str
    ordered: bool  #: whether the results of its kind rank the initializers

    def measured(self, runs: CaseRuns, repeats: int, readings: Sequence[str]) -> np.ndarray:
        """Its value under some readings, with bounds; shape: (3, N)."""
        measured = Measured(runs, list(map(self.read, readings)), repeats)
        result: np.ndarray = getattr(measured, self.measure)(self.model)
        return result

    def read(self, reading: str) -> str:
        """A reading of the queries about which the paper says this result to be."""
        return changed(reading, about=self.about) if self.about else reading


def results_of(paper: Mapping[str, Any], models: Models) -> list[PaperResult]:
    """The results of the paper that a reading decides, from its numbers."""
    listed = list[PaperResult]()
    for entry in ABOUT["results"]:
        values = value_of(paper, entry["key"])
        for name in entry.get("models", values):
            value = values[name] if isinstance(values, Mapping) else values
            result = PaperResult(
                kind=entry["kind"],
                place=entry["place"],
                title=entry["title"].format(models.labels[name]),
                model=name,
                paper=value[entry["part"]] if "part" in entry else value,
                case=entry["case"],
                measure=entry["measure"],
                about=entry.get("about", ""),
                ordered=entry.get("ordered", False),
            )
            listed.append(result)
    return listed


@dataclass(frozen=True, eq=False)
class Readings:
    """The cases that were run, and the paper's results under every reading."""

    paper: Mapping[str, Any]
    models: Models
    weight_decay: float  #: of fine-tuning, where a case changes nothing
    cases: Mapping[str, CaseRuns]

    @classmethod
    def read(cls, params: "Params", cases: Mapping[str, "ReadingCase"], models: Models) -> Self:
        """The tables of the cases."""
        result = dict[str, CaseRuns]()
        for name, case in cases.items():
            path = Path("data/beyond/readings", f"{name}.parquet")
            if path.exists():
                result[name] = CaseRuns.of(case, read(path))
        paper, decay = config.read(paths.PAPER), params.finetuning.weight_decay
        return cls(paper, models, decay, result)

    def __bool__(self) -> bool:
        """Whether the case was run without which there are no tables."""
        return MAIN in self.cases

    @cached_property
    def results(self) -> list[PaperResult]:
        """The paper's results whose case was run."""
        listed = results_of(self.paper, self.models)
        return [result for result in listed if result.case in self.cases]

    @cached_property
    def kinds(self) -> pd.Series:
        """The kind of each result."""
        return pd.Series([result.kind for result in self.results])

    def value(self, result: PaperResult, runs: CaseRuns, readings: Sequence[str]) -> np.ndarray:
        """A result measured on the runs of a case; shape: (3, N)."""
        return result.measured(runs, self.paper["settings"]["repeats"], readings)

    @cached_property
    def values(self) -> np.ndarray:
        """Every result under every reading, with bounds; shape: (results, 3, readings)."""
        measured = [
            self.value(result, self.cases[result.case], READINGS) for result in self.results
        ]
        return np.stack(measured)

    @cached_property
    def distance(self) -> pd.DataFrame:
        """How far each value is from the paper's, in half-widths of its interval, at most ``FAR``;
        rows: results; columns: readings.
        """
        paper = np.array([[result.paper] for result in self.results])
        value, low, high = self.values.swapaxes(0, 1)
        side = np.where(paper >= value, high - value, value - low)
        apart = np.abs(paper - value) / np.maximum(side, PRINTED)
        return pd.DataFrame(np.nan_to_num(apart, nan=FAR).clip(max=FAR), columns=READINGS)

    @cached_property
    def within(self) -> pd.DataFrame:
        """Whether the paper's number is within the interval; rows: results; columns: readings."""
        return self.distance <= 1

    @cached_property
    def by_kind(self) -> pd.DataFrame:
        """Number of results within their intervals; rows: readings; columns: kinds."""
        return self.within.groupby(self.kinds, sort=False).sum().T

    def nearest(self, kinds: Sequence[str] = (), among: Sequence[str] = ALLOWED) -> str:
        """The reading with the most results within, as a mean over kinds of their share; of equal
        ones that with the least mean distance over kinds.

        Args:
            kinds: that count; empty: all.
            among: readings.
        """
        ordered = self.ordered(kinds).index
        return str(ordered[ordered.isin(among)][0])

    def ordered(self, kinds: Sequence[str] = ()) -> pd.DataFrame:
        """``rank``, ``share`` (per cent) and ``distance`` of every reading, by the rule of
        ``nearest``.
        """
        counted = list(kinds) or list(map(str, self.by_kind))
        shares = (self.by_kind / self.kinds.value_counts())[counted].mean(axis=1)
        apart = self.distance.groupby(self.kinds).mean().loc[counted].mean()
        frame = pd.DataFrame({"share": 100 * shares.round(9), "distance": apart.round(9)})
        frame = frame.sort_values(["share", "distance"], ascending=[False, True], kind="stable")
        return frame.assign(rank=np.arange(1, 1 + len(frame)))

    @cached_property
    def chosen(self) -> str:
        """The nearest reading among those that the paper's words or its program allow."""
        return self.nearest()

    @property
    def neighbour(self) -> str:
        """The chosen reading with the other filter."""
        other = {"learned": "true", "true": "learned"}
        names = dict(zip(TITLES, self.chosen.split(), strict=True))
        return changed(self.chosen, filter=other[names["filter"]])

    @property
    def pairs(self) -> dict[str, str]:
        """The readings that tables compare."""
        return {
            "this reading": self.chosen,
            "other filter": self.neighbour,
            "this project's reading": OURS,
        }
