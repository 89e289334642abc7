"""Does it hold for other embeddings? Insertion into every family, on the graphs of the paper and of today."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import varied
from isi.report.figures import legend, panels
from isi.report.models import BASELINE, JOINT, colour, dashes, isi, label
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
        "MRR* (points) in scope novel right after insertion, mean over seeds and its interval.",
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
    return varied.by_model(cells[cells["scope"] == "novel_heldout"], "epochs", one.how.initializers, scale=1)


def frame(results: Results, found: Mapping[str, Varied], cells: Cells) -> pd.DataFrame:
    """A row for each experiment and family; ``cells`` gives the rest of it."""
    return pd.DataFrame(
        {"graph": results.experiments[experiment].title, "family": one.how.title, **cells(one, experiment)}
        for experiment in experiments(found)
        for one in found.values()
        if experiment in one.how.experiments
    )


def experiments(found: Mapping[str, Varied]) -> list[str]:
    """All that any of the variants ran, in order."""
    return list(dict.fromkeys(name for one in found.values() for name in one.how.experiments))


def in_words(found: Mapping[str, Varied]) -> str:
    """In how many pairs of family and graph the best of ISI is above Xavier, and who is best of all."""
    pairs = [about(one, experiment) for one in found.values() for experiment in one.how.experiments]
    methods = [label(name) for name in isi(next(iter(found.values())).how.initializers)]
    ahead = sum(max(values[name] for name in methods) > values[label(BASELINE)] for values in pairs)
    best = pd.Series([max((v, k) for k, v in one.items() if not k.endswith((" low", " high")) and k != label(JOINT))[1]
                      for one in pairs]).value_counts()  # fmt: skip
    return (
        "The paper says that ISI generalizes to other embeddings. Asked about the novel entity right after insertion, "
        f"the best of {joined(methods)} is above Xavier in {ahead} of {len(pairs)} pairs of a family and a graph. "
        f"First of all initializers: {joined(f'{name} in {number}' for name, number in best.items())}. Each family is "
        "trained with the rate and decay chosen for it on validation triples; fine-tuning rates stand to these as in "
        "the main runs."
    )


def drawn(results: Results, found: Mapping[str, Varied]) -> Canvas:
    """A panel for each graph: families along the axis, a line for each model."""
    names = experiments(found)
    canvas, axes = panels(len(names))
    models = next(iter(found.values())).models
    for panel, experiment in zip(axes, names, strict=True):
        own = [one for one in found.values() if experiment in one.how.experiments]
        for model in models:
            values = [about(one, experiment).get(label(model), np.nan) for one in own]
            how = {"color": colour(model, models), "label": label(model), "ls": dashes(model)}
            panel.plot(range(len(own)), values, marker="o", ms=4, lw=0.8, **how)
        panel.set_xticks(range(len(own)), [one.how.title for one in own])
        panel.set(title=results.experiments[experiment].title, ylabel="points")
    legend(canvas, axes)
    return canvas


SECTION = Section("embeddings", "Other embeddings", contents)
