"""The verdict: what is asked, and the answer in five sentences and one figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import statistics
from isi.report.figures import single
from isi.report.models import BASELINE, JOINT, colour, isi, label, of_role
from isi.report.parts import DIRECTIONS, directed
from isi.report.prose import capitalized, joined
from isi.report.results import Experiment, Results
from isi.report.section import Figure
from isi.report.sections.asked import CELL
from isi.report.sections.at_once import collapsed
from isi.report.statistics import HIGH, LOW, over_seeds

TITLE = "Incremental semantic initialization"
QUESTION = (
    "A robot knows its home as a knowledge-graph embedding and meets something new. Does it help to put the new entity "
    "where a few known ones are that its words (ES), its relations (RS) or both (ERS) point at, instead of somewhere "
    "at random (Xavier)? Daruna, Liu, Kira and Chernova (2019) say yes; this page asks again."
)
#: The control that knows an entity's kind and nothing else.
_KIND = "kind_mean"


@dataclass(frozen=True)
class Verdict:
    """The answer: sentences, and what was drawn of it."""

    sentences: Sequence[str]
    figure: Figure | None


@dataclass(frozen=True)
class _Found:
    """What the sentences are made of: means in points, by model."""

    experiment: Experiment
    everything: dict[str, float]
    #: with where the 95 % interval ends, by model
    about: pd.DataFrame

    @property
    def best(self) -> str:
        """Who leads of the paper's initializers, asked about the novel entity."""
        return max(isi(self.about.index), key=lambda model: float(self.about["mean"][model]))


def verdict(results: Results) -> Verdict:
    """The answer of the first graph of its own; nothing where none of ISI, or not Xavier, was run on any."""
    for experiment in results.own[:1]:
        if BASELINE in experiment.initializers and isi(experiment.initializers):
            everything = statistics.mrr_star(experiment.at_once, experiment.models).get("all", {})
            found = _Found(experiment, everything, asked_about(results, experiment))
            if {BASELINE, JOINT} <= set(found.about.index) and isi(found.about.index):
                return Verdict(list(sentences(results, found)), figure(found))
    return Verdict([], None)


def asked_about(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Queries that give the novel entity and ask for another; all that ask for entities where only those are told."""
    if experiment.name in results.asking:
        cells = directed(results.asking[experiment.name].queries, CELL)
        cells = cells[cells["scope"] == next(iter(DIRECTIONS))]
    else:
        cells = experiment.at_once[experiment.at_once["scope"] == "novel"]
    means = over_seeds(cells, ["model"], {"mrr_star_entity": "mean"})
    return means.reindex([model for model in experiment.models if model in means.index])


def sentences(results: Results, found: _Found) -> Iterator[str]:
    """Over all queries, about the novel entity, what it is made of, what is better, and what training does.

    Who has collapsed is told before.
    """
    experiment, best, everything = found.experiment, found.best, found.everything
    yield from collapsed(experiment)
    about = {str(model): float(value) for model, value in found.about["mean"].items()}
    yield (
        f"**{answer(experiment)}** Right after insertion, over all queries, {label(best)} has an MRR* (how near ranked "
        f"answers come to what was observed) of {everything.get(best, nan):.1f} points of 100 and Xavier of "
        f"{everything.get(BASELINE, nan):.1f}; a joint model, trained on everything from the start, has "
        f"{everything.get(JOINT, nan):.1f}."
    )
    yield (
        f"Most of these queries are about what was known before; **asked about the novel entity** itself, "
        f"{label(best)} has {about[best]:.1f}, Xavier {about[BASELINE]:.1f} and the joint model {about[JOINT]:.1f}."
    )
    if _KIND in about:
        yield (
            f"**Not all of that is meaning:** a vector in the middle of the entity's kind has {about[_KIND]:.1f}; what "
            f"words and relations tell of the entity itself is worth {about[best] - about[_KIND]:+.1f} "
            "([controls](#controls))."
        )
    if rivals := _rivals(found.about):
        first = rivals[0]
        beaten = "**More can be had:**" if about[first] > about[best] else "Others are not better:"
        yield f"{beaten} {label(first)} has {about[first]:.1f} there ([stronger initializers](#strong))."
    yield from _after_training(results, experiment, best)


def answer(experiment: Experiment) -> str:
    """Whether the paper's initializers gain over Xavier at once, over all queries and for certain."""
    gains = statistics.improvements(experiment.at_once, "all").reindex(isi(experiment.initializers))
    better = [label(str(model)) for model, low in gains["low"].items() if low > 0]
    if len(better) == len(gains):
        return "Yes."
    return f"In part: {joined(better)} for certain." if better else "Not for certain."


def _after_training(results: Results, experiment: Experiment, best: str) -> Iterator[str]:
    """How soon the start no longer matters, here and in the paper."""
    epochs = statistics.epochs(experiment.convergence, experiment.initializers).get("all", {})
    stated = results.paper["convergence"]["epochs"]
    if {best, BASELINE} <= set(epochs) and {best, BASELINE} <= set(stated):
        ours, theirs = ([values[model] for model in (BASELINE, best)] for values in (
            epochs, {model: numbers["mean"] for model, numbers in stated.items()}))  # fmt: skip
        yield (
            f"**Training makes up for a bad start:** over all queries, Xavier is near the joint model after "
            f"{ours[0]:.1f} epochs and {label(best)} after {ours[1]:.1f} (the paper: {theirs[0]:.1f} and "
            f"{theirs[1]:.1f}; [why not the same](#causes))."
        )


def _rivals(about: pd.DataFrame) -> list[str]:
    """Those that the paper does not have, best first."""
    return sorted(of_role(about.index, "baseline", "own"), key=lambda model: -float(about["mean"][model]))


def figure(found: _Found) -> Figure:
    """One line for each of those that the sentences name, asked about the novel entity."""
    about = found.about
    named = [BASELINE, "iu", _KIND, *isi(about.index), *_rivals(about)[:1], JOINT]
    shown = [model for model in named if model in about.index]
    return Figure(
        "verdict",
        f"{capitalized(found.experiment.title)}: asked about the novel entity, right after insertion",
        "MRR* (points) of the queries that give the novel entity and ask for another; mean and 95 % interval over "
        "seeds. The joint model has been trained on most of what is asked.",
        drawn(about.loc[shown], found.experiment.models),
    )


def drawn(about: pd.DataFrame, models: Sequence[str]) -> Canvas:
    """Means with their intervals, one below the other."""
    canvas, axes = single(width=4.6, height=0.5 + 0.33 * len(about))
    for place, (model, row) in enumerate(about.iterrows()):
        how: dict[str, Any] = {"color": colour(str(model), models)}
        axes.plot([0, row["mean"]], [place, place], lw=7, solid_capstyle="butt", alpha=0.35, **how)
        if pd.notna(row["mean" + LOW]):
            axes.plot([row["mean" + LOW], row["mean" + HIGH]], [place, place], lw=1.6, **how)
        axes.plot(row["mean"], place, marker="o", ms=5, **how)
        asked = pd.notna(row["mean"])
        end = max(row["mean"], row.get("mean" + HIGH, 0)) if asked else 0
        axes.annotate(f"{row['mean']:.1f}" if asked else "–", (end, place), (6, 0), textcoords="offset points",
                      va="center")  # fmt: skip
    axes.set_yticks(range(len(about)), [label(str(model)) for model in about.index])
    axes.set(xlim=(0, None), xlabel="MRR* (points)")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    return canvas
