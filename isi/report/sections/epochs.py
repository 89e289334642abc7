"""How soon fine-tuning converges: Figure 3b and Table 2 (section 6.2), and Table 2 at other rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from isi.learning.convergence import SCOPES
from isi.params import Params
from isi.report import statistics
from isi.report.figures import by_epoch
from isi.report.models import contenders, label
from isi.report.prose import reached
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.sections import rates

_CELLS = ["scope", "size", "model"]


def contents(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """Epochs to convergence in words, Figure 3b, Table 2, and what becomes of it at other rates."""
    params, initializers, convergence = results.params, experiment.initializers, experiment.convergence
    margin, most = params.convergence.margin, params.finetuning.max_epochs
    yield in_words(convergence, initializers, margin, most)
    if experiment.curve_size is None:
        yield f"No size in `experiments.{experiment.name}.followed` was inserted, so there is no curve to draw."
    else:
        yield curves(experiment.curves, initializers, experiment.curve_size, margin)
    yield table2(convergence, initializers, results.paper["convergence"]["epochs"], margin, most)
    yield convergence_by_size(convergence, initializers)
    if results.rates and results.rates.experiment is experiment:
        yield from at_other_rates(params, experiment, results.rates.found)


def at_other_rates(params: Params, experiment: Experiment, runs: pd.DataFrame) -> Iterator[Content]:
    """The study of rates."""
    size, varied = params.rates.size, [name for name in experiment.initializers if name in params.rates.initializers]
    main = experiment.runs[(experiment.runs["size"] == size) & experiment.runs["model"].isin(varied)]
    both = pd.concat([main.assign(factor=rates.AS_CHOSEN), runs[runs["model"].isin(varied)]])
    cells = experiment.converged(both, ["model", "factor"])
    told = " ".join(rates.order_of_initializers(cells, varied, scope) for scope in SCOPES)
    tuned = params.finetuning
    yield (
        "How many epochs anything takes depends on the fine-tuning rate, which is a choice "
        f"({tuned.learning_rate} here, in batches of {tuned.batch_size:,}). {told}"
    )
    yield rates.convergence_by_rate(cells, varied, size, tuned.learning_rate)


def in_words(convergence: pd.DataFrame, initializers: Sequence[str], margin: float, most: int) -> str:
    """When a run has converged, and how soon they do."""
    epochs, never = statistics.epochs(convergence, initializers), statistics.unconverged(convergence, initializers)
    tested = contenders(initializers)
    text = (
        f"A run has converged when it is within {100 * margin:g} points of the joint model of its seed; one that never "
        f"does so counts as {most} epochs."
    )
    for scope, what in (("all", "Mean number of epochs over all queries"),
                        ("novel_heldout", "About held-out triples of the novel entities")):  # fmt: skip
        if scope in epochs:
            text += f" {what}: {reached(epochs[scope], never[scope], tested)}."
    return text


def curves(runs: pd.DataFrame, initializers: Sequence[str], size: int, margin: float) -> Figure:
    """Figure 3b: MRR* by epoch of fine-tuning, of runs of one size."""
    return Figure(
        "figure3b_curves",
        "Figure 3b. Learning curves",
        f"MRR* by epoch of fine-tuning at |ξ| = {size}, mean and (but for controls) 95 % interval over seeds, over all "
        "queries (left, the paper's figure) and over held-out queries about novel entities (right). Dotted: where a "
        "run of mean joint performance counts as converged.",
        by_epoch(runs, initializers, ("all", "novel_heldout"), margin),
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
    for scope in SCOPES:
        cells = convergence[convergence["scope"] == scope].groupby("model")
        for column, values in (("mean", cells["epochs"].mean()), ("std", cells["epochs"].std(ddof=1)),
                               ("unconverged %", 100 * (1 - cells["converged"].mean()))):  # fmt: skip
            frame[f"{scope}: {column}"] = values.reindex(list(initializers)).to_numpy()
    for column, shown in (("mean", "mean"), ("deviation", "std")):
        frame[f"paper: {shown}"] = [stated.get(name, {}).get(column) for name in initializers]
    return Table(
        "table2_convergence",
        "Table 2. Epochs to convergence",
        f"Epochs until MRR* is within {100 * margin:g} points of the joint model of the same seed, over all sizes and "
        f"seeds; runs that never get there count as {most} and are the share given as unconverged.",
        frame,
    )


def convergence_by_size(convergence: pd.DataFrame, initializers: Sequence[str]) -> Table:
    """Table 2 for each size, with the number of queries that decide it."""
    frame = convergence.groupby(_CELLS).agg(
        mean=("epochs", "mean"), std=("epochs", "std"), converged=("converged", "mean"), queries=("queries", "mean"),
        sets=("seed", "size"),
    ).reset_index()  # fmt: skip
    frame["unconverged %"] = 100 * (1 - frame.pop("converged"))
    frame = statistics.in_order(frame, _CELLS, initializers)
    frame = frame.rename(columns={"model": "initializer", "queries": "triples asked"})
    return Table(
        "convergence_by_size",
        "Epochs to convergence by size",
        "As Table 2, for each size; triples asked: mean number of triples whose head, tail and relation are asked "
        "for; sets: sets of novel entities about which anything is asked.",
        frame[["scope", "size", "initializer", "mean", "std", "unconverged %", "triples asked", "sets"]],
        folded=True,
    )


SECTION = Section("epochs", "Epochs to convergence", contents)
