"""Headline numbers for ``dvc metrics`` and curves for ``dvc plots``, MRR* in points."""

from __future__ import annotations

from typing import Any

import pandas as pd

from isi.report import statistics, steady
from isi.report.models import BASELINE, JOINT
from isi.report.results import Experiment, Results
from isi.report.sections import affordances, asked, transfer

Numbers = dict[str, Any]


def metrics(results: Results) -> Numbers:
    """The headline numbers: those of the first experiment, and of each other under its name."""
    first, *others = results.experiments.values()
    return _of_experiment(results, first) | {one.name: _of_experiment(results, one) for one in others}


def _of_experiment(results: Results, experiment: Experiment) -> Numbers:
    numbers: Numbers = {
        "immediate_mrr_star": statistics.mrr_star(experiment.at_once, experiment.models),
        "epochs_to_convergence": statistics.epochs(experiment.convergence, experiment.models),
        "unconverged_percent": statistics.unconverged(experiment.convergence, experiment.models),
    }
    if experiment.how.graph.extend is None:
        graph = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        gains = {
            scope: {name: value for name, value in statistics.improvement(experiment.at_once, scope).items()
                    if name not in (BASELINE, JOINT)}
            for scope in ("all", "novel")
        }  # fmt: skip
        numbers = {"graph": graph, **numbers, "improvement_over_xavier_percent": gains}
    else:
        last = experiment.params.finetuning.max_epochs
        numbers["drop_percent"] = transfer.drop(experiment.at_once)
        numbers["known_closed_at_the_end"] = transfer.known_closed_at_the_end(experiment.curves, last)
    if experiment.name in results.asking:
        numbers["asked_about"] = asked.asked_about(results.asking[experiment.name].queries, experiment.models)
    study = results.affordances
    if study and study.experiment is experiment:
        numbers["affordances_percent"] = affordances.answers(study, results.params.affordances.relation).shares
    return _rounded(numbers)


def _rounded(values: Numbers) -> Numbers:
    """As files keep them, without those that are null."""
    known = {name: value for name, value in values.items() if isinstance(value, dict) or not pd.isna(value)}
    return {name: _rounded(value) if isinstance(value, dict) else steady.number(value) for name, value in known.items()}


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Means over seeds, one column a model."""
    frames = {}
    for experiment in results.own:
        means = 100 * experiment.at_once.groupby(["scope", "size", "model"])["mrr_star"].mean().unstack("model")
        for scope in ("all", "novel"):
            own = means.loc[scope] if scope in means.index.unique("scope") else means.head(0).droplevel("scope")
            frames[f"immediate_{scope}{experiment.suffix}"] = own.reset_index()
    named = [(experiment, f"curves_{{}}{experiment.suffix}") for experiment in results.own]
    named += [(experiment, f"{experiment.name}_{{}}") for experiment in results.extended]
    for experiment, name in named:
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            frames[name.format(scope)] = _curves(experiment, scope)
    return frames


def _curves(experiment: Experiment, scope: str) -> pd.DataFrame:
    runs = experiment.curves
    own = runs[(runs["scope"] == scope) & (runs["model"] != JOINT)]
    if own.empty:
        return pd.DataFrame(columns=["epoch", *experiment.initializers])
    means = own.groupby(["epoch", "model"])["mrr_star"].mean().unstack("model")
    return (100 * means.reindex(columns=experiment.initializers)).reset_index()
