"""Headline numbers for ``dvc metrics`` and curves for ``dvc plots``, MRR* in points."""

from __future__ import annotations

from typing import Any

import pandas as pd

from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.models import BASELINE, JOINT
from isi.report.sections import immediate, queries, transfer
from isi.report.tables import number

Numbers = dict[str, Any]


def metrics(results: Results) -> Numbers:
    """The headline numbers: those of the first experiment, and of each other under its name."""
    first, *others = results.experiments.values()
    return _of_experiment(results, first) | {one.name: _of_experiment(results, one) for one in others}


def _of_experiment(results: Results, experiment: Experiment) -> Numbers:
    numbers: Numbers = {
        "immediate_mrr_star": stats.mrr_star(experiment.immediate, experiment.models),
        "epochs_to_convergence": stats.epochs(experiment.convergence, experiment.models),
        "unconverged_percent": stats.unconverged(experiment.convergence, experiment.models),
    }
    if experiment.settings.graph.extend is None:
        graph = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        gains = {
            scope: {name: gain.mean for name, gain in stats.improvements(experiment.immediate, scope).items()
                    if name not in (BASELINE, JOINT)}
            for scope in ("all", "novel")
        }  # fmt: skip
        numbers = {"graph": graph, **numbers, "improvement_over_xavier_percent": gains}
    else:
        last = experiment.params.finetuning.max_epochs
        numbers["drop_percent"] = {name: drop.mean for name, drop in transfer.drops(experiment.immediate).items()}
        numbers["known_closed_at_the_end"] = transfer.known_closed_at_the_end(experiment.curves, last)
    if experiment.name in results.query_breakdown:
        given = queries.directions(results.query_breakdown[experiment.name].queries, experiment.models)["given"]
        numbers["novel_entity_given"] = {model: estimate.mean for model, estimate in given.items()}
    if (analysis := results.affordances) and analysis.experiment is experiment:
        answers = immediate.answers_of(analysis, results.params.affordances.relation)
        numbers["affordances_percent"] = answers.shares
    return _rounded(numbers)


def _rounded(values: Numbers) -> Numbers:
    """As files keep them, without those that are null."""
    known = {name: value for name, value in values.items() if isinstance(value, dict) or not pd.isna(value)}
    return {name: _rounded(value) if isinstance(value, dict) else number(value) for name, value in known.items()}


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Means over seeds, one column a model."""
    frames = {}
    for experiment in results.standalone:
        means = 100 * experiment.immediate.groupby(["scope", "size", "model"])["mrr_star"].mean().unstack("model")
        for scope in ("all", "novel"):
            rows = means.loc[scope] if scope in means.index.unique("scope") else means.head(0).droplevel("scope")
            frames[f"immediate_{scope}{experiment.suffix}"] = rows.reset_index()
    named = [(experiment, f"curves_{{}}{experiment.suffix}") for experiment in results.standalone]
    named += [(experiment, f"{experiment.name}_{{}}") for experiment in results.extended]
    for experiment, name in named:
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            frames[name.format(scope)] = _curves(experiment, scope)
    return frames


def _curves(experiment: Experiment, scope: str) -> pd.DataFrame:
    runs = experiment.curves
    rows = runs[(runs["scope"] == scope) & (runs["model"] != JOINT)]
    if rows.empty:
        return pd.DataFrame(columns=["epoch", *experiment.initializers])
    means = rows.groupby(["epoch", "model"])["mrr_star"].mean().unstack("model")
    return (100 * means.reindex(columns=experiment.initializers)).reset_index()
