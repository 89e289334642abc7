"""The paper's results under every reading of its metric: which reading fits, and what it leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import inf, nan, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from isi import config
from isi.config import value_of
from isi.report.tables.data import BASELINE, JOINT, Models, read
from isi.report.tables.estimates import ENDS, named, over_seeds, where, wide
from isi.report.tables.registry import Frames, table
from isi.tables import paths

if TYPE_CHECKING:
    from isi.analyses.readings import ReadingCase
    from isi.params import Params

#: What the paper's words say about the choices of a reading, readings of ``on_each_graph``, and
#: the results of the paper.
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
BEST = 10  #: Readings in the table of the nearest.
MAIN = "published"  #: The case without which there are no tables.
#: Cases from this project's run to the paper's, by that of the result: its conditions on today's
#: graph, the paper's conditions there, the paper's graph.
STEPS = {
    "published": ("ai2thor_batches", "ai2thor", "published"),
    "extended": ("transfer_batches", "transfer", "extended"),
}
GRAPHS = ("published", "extended", "ai2thor")


def about(reading: str, whom: str) -> str:
    """The reading with queries about others; as it is, if ``whom`` is empty."""
    queries, about, *others = reading.split()
    return " ".join([queries, whom or about, *others])


def allowed(reading: str) -> bool:
    """Whether the paper's words allow a reading."""
    choices = zip(ABOUT["words"].values(), reading.split(), strict=True)
    return all(words[choice] for words, choice in choices)


@dataclass(frozen=True, eq=False)
class CaseRuns:
    """The measures of a case: rows by model, number of indicators, size and seed, a column for each
    reading.
    """

    case: "ReadingCase | Any"
    mrr_star: pd.DataFrame  #: points, right after insertion
    #: epochs to convergence of sizes that are fine-tuned; infinite where a run ended before that
    #: was decided
    epochs: pd.DataFrame

    @classmethod
    def of(cls, case: "ReadingCase | Any", rows: pd.DataFrame) -> Self:
        """From the table of a case, with a column for each aspect of a reading."""
        first, *others = TITLES
        rows = rows.assign(reading=rows[first].str.cat(rows[others], sep=" "))
        index = ["model", "k", "size", "seed"]
        mrr_star = rows.pivot(index=index, columns="reading", values="mrr_star")[READINGS]
        epochs = rows.pivot(index=index, columns="reading", values="epochs")[READINGS]
        epochs = epochs.mask(epochs.isna() & mrr_star.notna(), inf)
        models, sizes = (epochs.index.get_level_values(name) for name in ("model", "size"))
        return cls(case, 100 * mrr_star, epochs[sizes.isin(case.finetuned) & (models != JOINT)])

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.case.initializers, JOINT]


def means_of(measured: pd.DataFrame, reading: str) -> pd.DataFrame:
    """Means over sizes and seeds under a reading, by model, with intervals; NaN where a run ended
    before it was decided.
    """
    rows = measured[reading].rename("mean").reset_index()
    means = over_seeds(where(rows, k=0), ["model"], {"mean": "mean"}, scale=1)
    return means.replace(inf, nan)


# The paper's results


@dataclass(frozen=True, eq=False)
class Measured:
    """The runs of a case with S seeds under N readings, weighted in 1 + S ways: all seeds alike,
    and without each of them.

    The methods by names of ``readings.yaml`` measure one model; shape: (3, N), ``estimate``.
    """

    runs: CaseRuns
    readings: Sequence[str]
    repeats: int  #: the paper's seeds

    @property
    def seeds(self) -> int:
        return int(self.runs.case.sessions.seeds)

    @property
    def sizes(self) -> list[int]:
        return sorted(self.runs.case.sessions.sizes)

    def mean(self, frame: pd.DataFrame, *place: Any) -> np.ndarray:
        """Means over the seeds with a value at a model, number of indicators and size; shape:
        (1 + S, N).
        """
        values = frame.loc[place, self.readings].to_numpy(float)
        weights = np.vstack([np.ones(self.seeds), 1 - np.eye(self.seeds)])
        present = ~np.isnan(values)
        with np.errstate(invalid="ignore", divide="ignore"):  # no queries, or undecided
            means: np.ndarray = weights @ np.where(present, values, 0.0) / (weights @ present)
        return means

    def estimate(self, values: np.ndarray) -> np.ndarray:
        """A value, and the bounds in which 95 % of such values over the paper's repeats would lie;
        ``values``: (..., 1 + S, N); shape: (3, ..., N).

        Student's t with the error of the jackknife, which is the usual one for a mean. A mean over
        other R seeds differs from ours by √(1 + S / R) times as much as ours from the true one.
        """
        value, others = values[..., 0, :], values[..., 1:, :]
        with np.errstate(invalid="ignore"):
            error = others.std(-2) * sqrt(self.seeds - 1)
        around = stdtrit(self.seeds - 1, 0.975) * sqrt(1 + self.seeds / self.repeats) * error
        parts = np.stack([value, value - around, value + around])
        return np.where(np.isfinite(value), parts, nan)

    def _by_size(self, model: str) -> np.ndarray:
        """Mean MRR* right after insertion; shape: (sizes, 1 + S, N)."""
        means = [self.mean(self.runs.mrr_star, model, 0, size) for size in self.sizes]
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
        powers, sizes = self.runs.epochs**power, self.runs.case.finetuned
        if not sizes:
            return np.full((1 + self.seeds, len(self.readings)), nan)
        return np.asarray(np.mean([self.mean(powers, model, 0, size) for size in sizes], 0))

    def epochs(self, model: str) -> np.ndarray:
        """Mean epochs to convergence over sizes and seeds (Table 2)."""
        return self.estimate(self._epochs(model, 1))

    def deviation(self, model: str) -> np.ndarray:
        """Standard deviation of the epochs to convergence over sizes and seeds (Table 2)."""
        number = len(self.runs.case.finetuned) * self.seeds
        with np.errstate(invalid="ignore"):  # undecided
            variance = self._epochs(model, 2) - self._epochs(model, 1) ** 2
        return self.estimate(np.sqrt(variance.clip(min=0) * number / (number - 1)))

    def best_indicators(self, model: str) -> np.ndarray:
        """The number of indicators with the highest mean MRR* right after insertion, at the first
        size (Figure 2a), and the least and the largest number that is not significantly worse.
        """
        numbers = self.runs.case.indicators[model]
        measured, size = self.runs.mrr_star, self.sizes[0]
        means = np.stack([self.mean(measured, model, k, size) for k in numbers])
        best = np.nan_to_num(means[:, 0]).argmax(0)
        _, worse, _ = self.estimate(np.take_along_axis(means, best[None, None], 0) - means)
        column = np.array(numbers, float)[:, None]
        alike = np.where(worse <= 0, column, nan)
        return np.stack([column[best, 0], np.fmin.reduce(alike), np.fmax.reduce(alike)])


@dataclass(frozen=True)
class PaperResult:
    """A result that the paper prints: its value, and how it is measured on a case."""

    place: str  #: in the paper
    title: str
    model: str
    paper: float
    case: str
    measure: str  #: the name of a method of ``Measured``
    about: str
    ordered: bool  #: whether the results of its measure rank the initializers

    def measured(self, runs: CaseRuns, repeats: int, readings: Sequence[str]) -> np.ndarray:
        """Its value under some readings, with bounds; shape: (3, N)."""
        names = [about(reading, self.about) for reading in readings]
        result: np.ndarray = getattr(Measured(runs, names, repeats), self.measure)(self.model)
        return result


def results_of(paper: Mapping[str, Any], models: Models) -> list[PaperResult]:
    """The results of the paper that a reading decides, from its numbers."""
    listed = list[PaperResult]()
    for entry in ABOUT["results"]:
        values = value_of(paper, entry["key"])
        for name in entry.get("models", values):
            value = values[name] if isinstance(values, Mapping) else values
            result = PaperResult(
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
    cases: Mapping[str, CaseRuns]  #: none without ``MAIN``

    @classmethod
    def read(cls, params: "Params", cases: Mapping[str, "ReadingCase"], models: Models) -> Self:
        """The tables of the cases."""
        result = dict[str, CaseRuns]()
        for name, case in cases.items():
            path = Path("data/beyond/readings", f"{name}.parquet")
            if path.exists():
                result[name] = CaseRuns.of(case, read(path))
        paper, decay = config.read(paths.PAPER), params.finetuning.weight_decay
        return cls(paper, models, decay, result if MAIN in result else {})

    @cached_property
    def results(self) -> list[PaperResult]:
        """The paper's results whose case was run."""
        listed = results_of(self.paper, self.models)
        return [result for result in listed if result.case in self.cases]

    def value(self, result: PaperResult, case: str, readings: Sequence[str]) -> np.ndarray:
        """A result measured on a case; shape: (3, N)."""
        return result.measured(self.cases[case], self.paper["settings"]["repeats"], readings)

    @cached_property
    def values(self) -> np.ndarray:
        """Every result under every reading, with bounds; shape: (results, 3, readings)."""
        return np.stack([self.value(result, result.case, READINGS) for result in self.results])

    @cached_property
    def distance(self) -> np.ndarray:
        """How far each value is from the paper's, in half-widths of its interval, at most ``FAR``;
        shape: (results, readings).
        """
        paper = np.array([[result.paper] for result in self.results])
        value, low, high = self.values.swapaxes(0, 1)
        side = np.where(paper >= value, high - value, value - low)
        apart = np.abs(paper - value) / np.maximum(side, PRINTED)
        return np.asarray(np.nan_to_num(apart, nan=FAR).clip(max=FAR))

    @cached_property
    def ranked(self) -> pd.DataFrame:
        """The readings by mean distance, the nearest first: rank, choices, whether the paper's
        words allow them, and how many results are within their intervals.
        """
        choices = [reading.split() for reading in READINGS]
        frame = pd.DataFrame(choices, READINGS, columns=list(TITLES))
        frame["allowed"] = [("no", "yes")[allowed(reading)] for reading in READINGS]
        frame["distance"] = self.distance.mean(0)
        frame["within"] = (self.distance <= 1).sum(0)
        frame = frame.iloc[frame["distance"].round(9).argsort(kind="stable")]
        frame.insert(0, "rank", [str(place + 1) for place in range(len(frame))])
        return frame

    @property
    def chosen(self) -> str:
        """The nearest reading among those that the paper's words allow."""
        return str(where(self.ranked, allowed="yes").index[0])

    @property
    def pairs(self) -> dict[str, str]:
        """The readings that tables compare."""
        return {"the chosen reading": self.chosen, "this project's": OURS}

    def by_label(self, names: Sequence[str], columns: Mapping[str, Any]) -> pd.DataFrame:
        """A row for each model: its label, then values by model."""
        series = {name: pd.Series(values, dtype=float) for name, values in columns.items()}
        frame = pd.DataFrame(series).reindex(list(names)).rename(index=self.models.labels)
        return frame.rename_axis("model").reset_index()

    def table2(self, part: str) -> dict[str, float]:
        """The paper's Table 2: mean or deviation of the epochs by model."""
        return {name: of[part] for name, of in self.paper["convergence"]["epochs"].items()}


# Tables


@table("readings")
def paper_results(results: Readings) -> pd.DataFrame | None:
    """Every result beside its value under the chosen reading, and under this project's."""
    if not results.cases:
        return None
    frame, place = pd.DataFrame(results.results), READINGS.index(results.chosen)
    for title, of in (("this reading", place), ("this project's reading", READINGS.index(OURS))):
        frame[[f"{title}{end}" for end in ENDS]] = results.values[:, :, of]
    group = [frame[name] for name in ("case", "measure", "about")]
    ranks = frame[["paper", "this reading"]].groupby(group).rank(method="first")
    is_equal = ranks["paper"] == ranks["this reading"]
    same_order = is_equal.groupby(group).transform("all") & frame["ordered"]
    is_within = results.distance[:, place] <= 1
    words = ["within the interval", "same order"]
    frame["and the paper"] = np.select([is_within, same_order], words, "not explained")
    columns = [*frame.columns[8:11], "and the paper", *frame.columns[11:14]]
    frame = frame.rename(columns={"place": "where", "title": "what"})
    return frame[["where", "what", "paper", *columns]]


@table("readings")
def readings_within(results: Readings) -> pd.DataFrame | None:
    """How many results lie within their intervals under the chosen reading, and this project's."""
    if not results.cases:
        return None
    frame = results.ranked.loc[[results.chosen, OURS], ["within"]]
    frame.insert(0, "reading", ["one allowed by the paper's words", "this project's"])
    return frame.assign(results=len(results.results))


@table("readings")
def nearest(results: Readings) -> Frames | None:
    """The nearest readings, the chosen one and this project's; and the neighbours of the chosen
    one, which differ from it in a single aspect.
    """
    if not results.cases:
        return None
    ranked, chosen = results.ranked, results.chosen
    differing = (ranked[list(TITLES)] != chosen.split()).sum(axis=1)
    return {
        "nearest_readings": ranked[
            (np.arange(len(ranked)) < BEST) | ranked.index.isin([chosen, OURS])
        ],
        "neighbours_of_the_reading": ranked[differing == 1],
    }


@table("readings")
def steps_to_the_paper(results: Readings) -> pd.DataFrame | None:
    """How much of each gap the reading, the conditions and the graph explain."""
    if not results.cases:
        return None
    chosen, rows = results.chosen, list[dict[str, Any]]()
    for result in results.results:
        cases = STEPS.get(result.case, ())
        if cases and set(cases) <= set(results.cases):
            batches, today, theirs = cases
            row: dict[str, Any] = {"what": result.title}
            for name, case, reading in (
                ("this run", batches, OURS),
                ("the reading", batches, chosen),
                ("the conditions", today, chosen),
                ("the graph", theirs, chosen),
            ):
                row[name] = results.value(result, case, [reading])[0, 0]
            rows.append(row | {"paper": result.paper})
    return pd.DataFrame(rows)


@table("readings")
def on_each_graph(results: Readings) -> Frames:
    """MRR* right after insertion of every model under named readings, on each graph."""
    frames = dict[str, pd.DataFrame]()
    for case in GRAPHS:
        if case in results.cases:
            runs, rows = results.cases[case], list[dict[str, Any]]()
            for title, reading in ABOUT["shown"].items():
                means = means_of(runs.mrr_star, reading).reindex(runs.models)
                rows.append({"reading": title} | wide(means, "mean", results.models.labels))
            frames[f"readings_{case}"] = pd.DataFrame(rows)
    return frames


@table("readings")
def table2_readings(results: Readings) -> Frames:
    """Table 2 under both readings: epochs to convergence, beside the paper's."""
    frames = dict[str, pd.DataFrame]()
    for case in (MAIN, "ai2thor"):
        if case not in results.cases or results.cases[case].epochs.empty:
            continue
        runs, columns = results.cases[case], dict[str, Any]()
        for title, reading in results.pairs.items():
            decided = runs.epochs[reading].replace(inf, nan)
            columns |= named(means_of(runs.epochs, reading), "mean", f"{title}: mean")
            columns[f"{title}: deviation"] = decided.groupby("model").std()
        columns |= {f"paper: {part}": results.table2(part) for part in ("mean", "deviation")}
        frames[f"table2_readings_{case}"] = results.by_label(runs.case.initializers, columns)
    return frames


@table("readings")
def transfer_readings(results: Readings) -> pd.DataFrame | None:
    """The transfer's MRR* right after insertion, over all queries and about the new entities,
    beside the paper's.
    """
    if "extended" not in results.cases:
        return None
    runs, columns, paper = results.cases["extended"], dict[str, Any](), results.paper["transfer"]
    for title, whom, theirs in (
        ("all queries", "", paper["all_queries"]),
        ("new entities", "novel", paper["novel_queries"]),
    ):
        for name, reading in results.pairs.items():
            means = means_of(runs.mrr_star, about(reading, whom))
            columns |= named(means, "mean", f"{title}: {name}")
        columns[f"{title}: paper"] = theirs
    return results.by_label(runs.models, columns)


@table("readings")
def decay_readings(results: Readings) -> pd.DataFrame | None:
    """Epochs to convergence at the sizes of both cases, with each weight decay of fine-tuning."""
    if "decay" not in results.cases:
        return None
    compared, columns = [results.cases[MAIN], results.cases["decay"]], dict[str, Any]()
    main, other = (set(runs.case.finetuned) for runs in compared)
    for runs in compared:
        epochs = runs.epochs.query("size in @sizes", local_dict={"sizes": list(main & other)})
        decay = runs.case.changes.get("finetuning.weight_decay", results.weight_decay)
        columns |= named(means_of(epochs, results.chosen), "mean", f"weight decay of {decay:g}")
    columns["paper"] = results.table2("mean")
    return results.by_label(compared[1].case.initializers, columns)
