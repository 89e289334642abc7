"""How soon fine-tuning converges: Figure 3b and Table 2 (section 6.2), and Table 2 at other rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from isi.evaluation.convergence import SCOPES
from isi.params import Params
from isi.report import statistics
from isi.report.figures import by_epoch
from isi.report.models import contenders, isi, label
from isi.report.paired import difference
from isi.report.prose import listed, reached
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.sections import rates

_CELLS = ["scope", "size", "model"]


def contents(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """Epochs to convergence in words, Figure 3b, Table 2, and what becomes of it at other rates."""
    params, initializers, convergence = results.params, experiment.finetuned, experiment.convergence
    margin, most = params.convergence.margin, params.finetuning.max_epochs
    yield in_words(convergence, initializers, margin, most)
    if experiment.curve_size is None:
        yield f"No size in `experiments.{experiment.name}.full_curves` was inserted, so there is no curve to draw."
    else:
        yield curves(experiment.curves, initializers, experiment.curve_size, margin)
        yield best_epochs(experiment.curves, initializers, experiment.curve_size)
    yield table2(convergence, initializers, results.paper["convergence"]["epochs"], margin, most)
    yield convergence_by_size(convergence, initializers)
    if results.rates and results.rates.experiment is experiment:
        yield from at_other_rates(params, experiment, results.rates.found)


def at_other_rates(params: Params, experiment: Experiment, runs: pd.DataFrame) -> Iterator[Content]:
    """The study of rates."""
    size, varied = (
        params.rate_sweep.size,
        [name for name in experiment.finetuned if name in params.rate_sweep.initializers],
    )
    if not varied:
        return
    main = experiment.runs[(experiment.runs["size"] == size) & experiment.runs["model"].isin(varied)]
    both = pd.concat([main.assign(factor=rates.AS_CHOSEN), runs[runs["model"].isin(varied)]])
    cells = experiment.converged(both, ["model", "factor"])
    told = " ".join(rates.order_of_initializers(cells, varied, scope) for scope in SCOPES)
    tuned = params.finetuning
    yield (
        f"How many epochs anything takes depends on the fine-tuning rate, which is a choice ({tuned.learning_rate} "
        f"here, in batches of {tuned.batch_size:,}), and no rate is fair to all: it decides how long those who start "
        f"far away need, and whether they arrive. So Table 2 stands at every rate that was run. {told}"
    )
    yield rates.convergence_by_rate(cells, varied, size, tuned.learning_rate, params.finetuning.max_epochs)


def in_words(convergence: pd.DataFrame, initializers: Sequence[str], margin: float, most: int) -> str:
    """When a run has converged, and how soon they do."""
    epochs, never = statistics.epochs(convergence, initializers), statistics.unconverged(convergence, initializers)
    middle = statistics.by_scope(convergence.groupby(["scope", "model"])["epochs"].median(), initializers)
    tested = contenders(initializers)
    text = (
        f"A run has converged when it is within {100 * margin:g} points of the joint model of its seed. One that never "
        f"does so is counted as {most} epochs, so means are of censored runs; shares and medians are not."
    )
    for scope, what in (("all", "Over all queries"), ("novel_heldout", "About held-out triples of the novel entities")):
        if scope in epochs:
            text += (
                f" {what}, mean epochs: {reached(epochs[scope], never[scope], tested)}; medians: "
                f"{listed(middle[scope], tested, '{:g}')}."
            )
    return text


def best_epochs(runs: pd.DataFrame, initializers: Sequence[str], size: int) -> str:
    """How far held-out MRR* falls from the best epoch of its mean to the last."""
    cells = 100 * runs[runs["scope"] == "novel_heldout"].pivot_table("mrr_star", ["model", "epoch"], "seed")
    told = []
    for model in isi(name for name in initializers if name in cells.index.unique("model")):
        own = pd.DataFrame(cells.xs(model, level="model"))
        means, epochs = own.mean(axis=1), own.index.to_numpy()
        best, last = int(epochs[means.to_numpy().argmax()]), int(epochs.max())
        change = difference((own.loc[last] - own.loc[best]).dropna().to_numpy())
        told.append(f"{label(model)} {means[best]:.1f} at epoch {best} and {means[last]:.1f} at {last}, {change}")
    if not told:
        return f"At |ξ| = {size} nothing about held-out triples was asked of ISI."
    return (
        f"More training is not always better. MRR* about held-out triples of the novel entities at |ξ| = {size}, at "
        "the best epoch of the mean curve (chosen with hindsight) and at the last, and the change with its interval: "
        f"{'; '.join(told)}."
    )


def curves(runs: pd.DataFrame, initializers: Sequence[str], size: int, margin: float) -> Figure:
    """Figure 3b: MRR* by epoch of fine-tuning, of runs of one size."""
    return Figure(
        "figure3b_curves",
        "Figure 3b. Learning curves",
        f"MRR* by epoch of fine-tuning at |ξ| = {size}, mean and (but for controls) 95 % interval over seeds, over all "
        "queries (left, the paper's figure) and over held-out queries about novel entities (right). Dotted: where a "
        "run of mean joint performance counts as converged.",
        by_epoch(runs, initializers, ("all", "novel_heldout"), margin=margin),
    )


def table2(
    convergence: pd.DataFrame,
    initializers: Sequence[str],
    stated: Mapping[str, Mapping[str, float]],
    margin: float,
    most: int,
) -> Table:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    frame = pd.DataFrame({"initializer": [label(name) for name in initializers]})
    found = summarized(convergence, ["scope", "model"])
    for scope in SCOPES:
        for column in found.columns:
            values = [found[column].get((scope, model), np.nan) for model in initializers]
            frame[f"{scope}: {column}"] = pd.Series(values, dtype=float)
    for column, shown in (("mean", "mean"), ("deviation", "std")):
        frame[f"paper: {shown}"] = [stated.get(name, {}).get(column) for name in initializers]
    return Table(
        "table2_convergence",
        "Table 2. Epochs to convergence",
        f"Epochs until MRR* is within {100 * margin:g} points of the joint model of the same seed, over all sizes and "
        f"seeds: mean with its interval over seeds, deviation and median. Runs that never get there count as {most} in "
        "these and are the share given as unconverged.",
        frame,
    )


def summarized(convergence: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Epochs to convergence by group: mean, deviation, median and the share that never gets there, with intervals."""
    means = statistics.over_seeds(convergence, by, {"epochs": "mean"}, scale=1)
    lost = convergence.assign(lost=~convergence["converged"])
    never = statistics.over_seeds(lost, by, {"lost": "unconverged %"})
    epochs = convergence.groupby(list(by))["epochs"]
    middle = pd.DataFrame({"std": epochs.std(ddof=1), "median": epochs.median()})
    return pd.concat([means, middle, never], axis=1)


def convergence_by_size(convergence: pd.DataFrame, initializers: Sequence[str]) -> Table:
    """Table 2 for each size, with the number of queries that decide it."""
    groups = convergence.groupby(_CELLS)
    frame = summarized(convergence, _CELLS).drop(columns="std")
    frame = frame.assign(**{"triples asked": groups["queries"].mean(), "sets": groups.size()})
    frame = statistics.in_order(frame.reset_index(), _CELLS, initializers)
    return Table(
        "convergence_by_size",
        "Epochs to convergence by size",
        "As Table 2, for each size; triples asked: mean number of triples whose head, tail and relation are asked "
        "for; sets: sets of novel entities about which anything is asked.",
        frame.rename(columns={"model": "initializer"}),
        folded=True,
    )


SECTION = Section("epochs", "How many epochs it saves", contents)
