"""Does it hold for other embeddings? Insertion into every family, on the graphs of the paper and of today."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from isi.report import varied
from isi.report.figures import legend, panels
from isi.report.models import BASELINE, colour, dashes, isi, label
from isi.report.prose import joined
from isi.report.results import Results
from isi.report.section import Content, Figure, Section, Table
from isi.report.varied import Varied

#: Of a variant and an experiment, the rest of a table's row.
Cells = Callable[[Varied, str], dict[str, float]]


def contents(results: Results) -> Iterator[Content]:
    """Who is ahead at once in each family, what they have, and how soon they converge."""
    found = varied.group(results.beyond, "embeddings")
    if not found:
        return
    yield in_words(found)
    yield Figure(
        "embeddings",
        "Other embeddings: asked about the novel entity",
        "Entity half of MRR* (points) of the queries that give a novel entity and ask what belongs to it, right after "
        "insertion, by family of embeddings.",
        drawn(results, found),
    )
    yield Table(
        "embeddings_at_once",
        "Other embeddings: MRR* at once",
        "MRR* (points) about novel entities right after insertion, mean over seeds and its interval.",
        frame(results, found, novel),
    )
    yield Table(
        "embeddings_asked_about",
        "Other embeddings: asked about the novel entity",
        "What the figure shows, with the interval over seeds.",
        frame(results, found, about),
    )
    yield Table(
        "embeddings_epochs",
        "Other embeddings: epochs to convergence",
        "Mean epochs until MRR* about held-out triples of the novel entities is within the margin of the joint model "
        "of the same family and seed; those that never get there count as all epochs.",
        frame(results, found, partial(epochs, results)),
    )


def novel(one: Varied, experiment: str) -> dict[str, float]:
    """What each model has in scope novel at once."""
    return varied.by_model(one.at_once(experiment, "novel"), "mrr_star", one.models)


def about(one: Varied, experiment: str) -> dict[str, float]:
    """What each model answers about novel entities."""
    return varied.by_model(one.about_in(experiment), "mrr_star_entity", one.models)


def epochs(results: Results, one: Varied, experiment: str) -> dict[str, float]:
    """Epochs to convergence about held-out triples."""
    cells = one.convergence(experiment, results.params)
    return varied.by_model(cells[cells["scope"] == "novel_heldout"], "epochs", one.initializers, scale=1)


def frame(results: Results, found: Mapping[str, Varied], cells: Cells, what: str = "family") -> pd.DataFrame:
    """A row for each experiment and variant; ``what`` variants are, and ``cells`` gives the rest of a row."""
    return pd.DataFrame(
        {"graph": results.experiments[experiment].title, what: one.how.title, **cells(one, experiment)}
        for experiment in experiments(found)
        for one in found.values()
        if experiment in one.experiments
    )


def experiments(found: Mapping[str, Varied]) -> list[str]:
    """All that any of the variants ran, in order."""
    return list(dict.fromkeys(name for one in found.values() for name in one.experiments))


def in_words(found: Mapping[str, Varied]) -> str:
    """In how many pairs of family and graph the best of ISI is above Xavier, and who is best of all."""
    pairs = [about(one, experiment) for one in found.values() for experiment in one.experiments]
    names = list(dict.fromkeys(name for one in found.values() for name in one.initializers))
    everyone, methods = [label(name) for name in names], [label(name) for name in isi(names)]
    ahead = sum(first(values, [label(BASELINE), *methods]) in methods for values in pairs)
    best = Counter(first(values, everyone) for values in pairs)
    return (
        "The paper says that ISI generalizes to other embeddings. Asked about the novel entity right after insertion, "
        f"the best of {joined(methods)} is above {label(BASELINE)} in {ahead} of {len(pairs)} pairs of a family and a "
        f"graph. First of all initializers: {joined(f'{name} in {number}' for name, number in best.most_common())}. "
        "Each family is trained with the rate and decay chosen for it on validation triples; fine-tuning rates stand "
        "to these as in the main runs."
    )


def first(values: Mapping[str, float], names: Sequence[str]) -> str:
    """Who of some has most; the one named first where several have."""
    return max((name for name in names if name in values), key=lambda name: values[name], default="none")


def drawn(results: Results, found: Mapping[str, Varied]) -> Canvas:
    """A panel for each graph: families along the axis, a line for each model."""
    names = experiments(found)
    canvas, axes = panels(len(names))
    models = next(iter(found.values())).models
    for panel, experiment in zip(axes, names, strict=True):
        own = [one for one in found.values() if experiment in one.experiments]
        lines(panel, pd.DataFrame(about(one, experiment) for one in own), models, [one.how.title for one in own])
        panel.set_title(results.experiments[experiment].title)
    legend(canvas, axes)
    return canvas


def lines(axes: Axes, rows: pd.DataFrame, models: Sequence[str], ticks: Sequence[str]) -> None:
    """A line for each model through the rows, in points; ``rows`` have a column for each model's label."""
    for model in models:
        values = rows.get(label(model), pd.Series(np.nan, rows.index))
        how = {"color": colour(model, models), "label": label(model), "ls": dashes(model)}
        axes.plot(range(len(rows)), values, marker="o", ms=4, lw=1, **how)
    axes.set_xticks(range(len(rows)), ticks)
    axes.set_ylabel("points")


SECTION = Section("embeddings", "Other embeddings", contents)
