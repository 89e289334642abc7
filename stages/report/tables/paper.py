"""The paper's results beside ours: on its own graph and under its conditions, and on today's."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import isnan, nan
from pathlib import Path
from typing import Any

import pandas as pd

from isi import config
from isi.config import value_of
from isi.evaluation.changes import CHANGES
from isi.evaluation.scopes import GROUPS
from stages.grid import JOINT_MODEL
from stages.report.scopes import TITLES
from stages.report.tables.data import Experiment, Results
from stages.report.tables.estimates import BASELINE, CELL, Estimate, TableRow, bounded, where
from stages.report.tables.forms import ANY_SIZE
from stages.report.tables.registry import table
from stages.report.tables.statistics import (
    ISI,
    METHODS,
    Statistics,
    best_indicators,
    right_after,
)

#: The results of the paper; the file says how they are written.
_RESULTS = Path(__file__).with_name("paper_results.yaml")
#: Half of the last digit that the paper prints.
PRINTED = 0.05
#: Statistics of epochs, which have a second form.
OF_EPOCHS = ("mean_epochs", "deviation", "fewer_epochs")
#: Models of the table of the answer, as far as they were run.
SHOWN = (BASELINE, "iu", "mean", *METHODS, "map", JOINT_MODEL)


# The answer


@table("report")
def answer(results: Results) -> pd.DataFrame | None:
    """The answer of the report: what each initializer gains and costs on both graphs, with the
    paper's numbers below those on its own graph.
    """
    rows = list[TableRow]()
    for experiment in results.standalone:
        transfer = results.transfer_of(experiment)
        theirs = results.paper if experiment is results.on(papers=True) else {}
        rows += _answer(experiment, transfer, theirs)
    frame = pd.DataFrame(rows)
    names = {name: results.models.labels[name] for name in SHOWN if name in frame}
    shown = frame[["graph", "measure", *names]].dropna(how="all", subset=list(names))
    return shown.dropna(how="all", axis=1).rename(columns=names)


def _answer(
    experiment: Experiment, transfer: Experiment | None, paper: Mapping[str, Any]
) -> list[TableRow]:
    """The rows of one graph."""
    statistics, models = experiment.statistics(), experiment.rows
    others = [name for name in experiment.initializers if name != BASELINE]
    tuned = [name for name in experiment.finetuned if name != BASELINE]
    printed_epochs = value_of(paper, "convergence.epochs") or {}
    printed_fewer = value_of(paper, "convergence.fewer_epochs_than_xavier") or {}
    rows: dict[str, Mapping[str, float] | None] = {
        "gain over Xavier, %": {name: statistics.gain(name)[0] for name in others},
        "gain over Xavier, %: the paper": value_of(paper, "immediate.improvement_over_xavier"),
    }
    for group in GROUPS:
        title = f"MRR right after insertion: {TITLES[group]}"
        rows[title] = {name: getattr(statistics, group)(name)[0] for name in models}
    epochs = {name: statistics.mean_epochs(name)[0] for name in experiment.finetuned}
    rows["epochs of fine-tuning"] = epochs
    epochs_of_paper = {name: printed["mean"] for name, printed in printed_epochs.items()}
    rows["epochs of fine-tuning: the paper"] = epochs_of_paper
    fewer = {name: statistics.fewer_epochs(name)[0] for name in tuned}
    rows["fewer epochs than Xavier, %"] = fewer
    fewer_of_paper = {name: per_cent for name, per_cent in printed_fewer.items() if name in METHODS}
    rows["fewer epochs than Xavier, %: the paper"] = fewer_of_paper
    if transfer is not None:
        title = "drop of earlier knowledge in the transfer, %"
        rows[title] = {BASELINE: transfer.statistics().drop(BASELINE)[0]}
        rows[f"{title}: the paper"] = value_of(paper, "transfer.drop")
    return [
        {"graph": experiment.title, "measure": measure, **(values or {})}
        for measure, values in rows.items()
    ]


# Every result that the paper prints


@dataclass(frozen=True)
class PaperResult:
    """A result that the paper prints, and the statistic of runs that repeats it."""

    kind: str
    place: str  #: in the paper
    model: str
    paper: float  #: null where the paper prints none
    statistic: str  #: a method of ``Statistics``, or ``best_indicators``
    extended: bool  #: whether it is of the transfer

    @property
    def other_form(self) -> str:
        """A second form of the statistic in words; empty without one."""
        if self.statistic == "weighted":
            return "by the paper's weights"
        if self.statistic == "gain":
            return "mean of the sizes' gains"
        return "runs that end" if self.statistic in OF_EPOCHS else ""

    def measured(self, results: Results, papers: bool, other: bool = False) -> Estimate:
        """The statistic of our runs on the paper's own graph, or on today's; ``other``: in its
        second form.
        """
        experiment = results.on(papers, self.extended)
        if experiment is None:
            return nan, nan, nan
        if self.statistic == "best_indicators":
            if experiment.sweep is None:
                return nan, nan, nan
            rows = right_after(experiment.sweep, self.model)
            return (nan, nan, nan) if rows.empty else best_indicators(rows)
        statistics, name = _statistics(experiment), self.statistic
        if other and name in OF_EPOCHS:
            statistics = statistics.ended
        elif other:
            name = "gain_by_size" if name == "gain" else "by_papers_share"
        estimate: Estimate = getattr(statistics, name)(self.model)
        return estimate


@cache
def _statistics(experiment: Experiment) -> Statistics:
    return experiment.statistics()


def results_of(paper: Mapping[str, Any]) -> list[PaperResult]:
    """The results that the paper prints, from its numbers."""
    printed = list[PaperResult]()
    for entry in _entries():
        values = value_of(paper, entry["key"])
        numbers = values if isinstance(values, dict) else dict.fromkeys(entry["models"], values)
        for name, number in numbers.items():
            # ``mean`` is an initializer of ours
            model = ISI if name == "mean" else name
            result = PaperResult(
                kind=entry["kind"],
                place=entry["place"],
                model=model,
                paper=float(number[entry["part"]] if "part" in entry else number)
                if name in entry.get("printed", numbers)
                else nan,
                statistic=entry["statistic"],
                extended=entry.get("extended", False),
            )
            printed.append(result)
    return printed


def _entries() -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = config.read(_RESULTS)["results"]
    return entries


@table("report")
def paper_results(results: Results) -> pd.DataFrame:
    """Every result that the paper prints, ours on its own graph with the 95 % interval, whether
    the paper's is inside, and ours on today's graph.
    """
    rows = list[TableRow]()
    labels = {**results.models.labels, ISI: "mean of ISI"}
    for result in results_of(results.paper):
        ours = result.measured(results, papers=True)
        row: TableRow = {"where": result.place, "kind": result.kind, "whose": labels[result.model]}
        row |= {"paper": result.paper, **bounded("ours", ours)}
        row["inside"] = inside(result.paper, ours)
        other = (nan, nan, nan)
        if result.other_form:
            other = result.measured(results, papers=True, other=True)
        row |= {"other form": result.other_form, **bounded("ours in it", other)}
        row["inside in it"] = inside(result.paper, other)
        row |= bounded("today's graph", result.measured(results, papers=False))
        rows.append(row)
    frame = pd.DataFrame(rows)
    frame.attrs[ANY_SIZE] = ["paper"]
    return frame


def inside(paper: float, ours: Estimate) -> str:
    """Whether the paper's number lies within our interval, to the digit that it prints; empty
    without an interval, or where it prints none.
    """
    _, low, high = ours
    if not low <= high or isnan(paper):
        return ""
    return "yes" if low - PRINTED <= paper <= high + PRINTED else "no"


@table("report")
def inside_by_kind(results: Results) -> pd.DataFrame:
    """How many of the numbers that the paper prints are inside our intervals, by kind; one number
    of several models is inside if it is for each of them.
    """
    return counted(paper_results(results))


def counted(frame: pd.DataFrame) -> pd.DataFrame:
    """``inside_by_kind`` of the rows of ``paper_results``."""
    frame = frame[frame["paper"].notna()]
    first, other = frame["inside"] == "yes", frame["inside in it"] == "yes"
    within = pd.DataFrame({"inside": first, "inside in either form": first | other}).astype(int)
    within.insert(0, "number", 1)
    groups = within.groupby(frame["kind"], sort=False)
    counts, of_all = groups.sum(), groups.min()
    once = [entry["kind"] for entry in _entries() if "models" in entry]
    once = [kind for kind in once if kind in counts.index]
    counts.loc[once] = of_all.loc[once]
    counts.loc["all"] = counts.sum()
    return counts.astype(int).rename_axis("results").reset_index()


@table("report")
def unexplained(results: Results) -> pd.DataFrame:
    """The results outside our intervals in both forms: ours minus the paper's in the first, and
    how many half-widths of the interval it is away.
    """
    frame = paper_results(results)
    frame = frame[(frame["inside"] == "no") & (frame["inside in it"] != "yes")]
    apart = frame["ours"] - frame["paper"]
    half = ((frame["ours high"] - frame["ours low"]) / 2).clip(lower=PRINTED)
    columns = ["where", "kind", "whose", "paper", "ours", "ours low", "ours high"]
    return frame[columns].assign(
        **{"ours minus the paper's": apart, "half-widths away": apart.abs() / half}
    )


# What the measure decides


@table("report")
def measure_decides(results: Results) -> pd.DataFrame | None:
    """The paper's headline numbers on its own graph, by its measure and with one part of the
    measure changed at a time; then the paper's.
    """
    experiment = results.on(papers=True)
    if experiment is None or experiment.changes is None:
        return None
    transfer, rows = results.transfer_of(experiment), list[TableRow]()
    labels = results.models.labels
    for name, change in CHANGES.items():
        statistics, row = changed(experiment, name), TableRow(measure=change.title)
        for model in METHODS:
            row |= bounded(f"gain over Xavier, %: {labels[model]}", statistics.gain(model))
        row |= bounded("fewer epochs, %", statistics.fewer_epochs(ISI))
        if transfer is not None and transfer.changes is not None:
            row |= bounded("transfer: drop, %", changed(transfer, name).drop(BASELINE))
        rows.append(row)
    paper = results.paper
    gains = paper["immediate"]["improvement_over_xavier"]
    last: TableRow = {f"gain over Xavier, %: {labels[model]}": gains[model] for model in METHODS}
    last["fewer epochs, %"] = paper["convergence"]["fewer_epochs_than_xavier"]["mean"]
    last["transfer: drop, %"] = paper["transfer"]["drop"][BASELINE]
    rows.append({"measure": "the paper", **last})
    return pd.DataFrame(rows, columns=list(rows[0]))


def changed(experiment: Experiment, change: str) -> Statistics:
    """The statistics of an experiment by the measure with one part changed."""
    assert experiment.changes is not None  # noqa: S101  # the callers ask before
    rows = where(experiment.changes, change=change).rename(columns={"value": "mrr"})
    immediate = where(rows, epoch=0).assign(value=100 * where(rows, epoch=0)["mrr"])
    # where all of D¹ is one group, this one has to converge
    groups = [group for group in GROUPS if group in set(rows["scope"])] or ["weighted"]
    grouped = where(rows, scope=groups)
    if groups == ["weighted"]:
        grouped = grouped.assign(scope=GROUPS[0])
    joint = where(grouped, model=JOINT_MODEL)
    runs = where(grouped, model=experiment.finetuned)
    epochs = experiment.converged(runs, ["model"], experiment.finetuned_seeds, joint)
    return Statistics(immediate[["model", "scope", *CELL, "value"]], epochs)
