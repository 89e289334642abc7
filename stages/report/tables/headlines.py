"""Headline numbers for ``dvc metrics``, and curves for ``dvc plots``."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from isi.tables.io import atomically
from stages.report.scopes import GROUPED
from stages.report.tables import registry
from stages.report.tables.affordances import answers_of
from stages.report.tables.data import Experiment, Results
from stages.report.tables.estimates import BASELINE, epochs_summary, where
from stages.report.tables.forms import csv, number

#: The headline numbers, beside the page.
METRICS = "metrics.json"
#: Experiments of dvc.yaml's plots.
STANDALONE, EXTENDED = ("paper", "ai2thor"), ("paper_transfer", "transfer")


def write(results: Results, folder: Path) -> None:
    """Write the plots and the headline numbers of the first pipeline."""
    texts = {f"{name}.csv": csv(frame) for name, frame in plots(results).items()}
    registry.write_files(folder / "plots", texts)
    text = json.dumps(metrics(results), indent=2)
    atomically(folder / METRICS, partial(Path.write_bytes, data=f"{text}\n".encode()))


def metrics(results: Results) -> dict[str, Any]:
    """Headline numbers of each experiment, by its name."""
    numbers = {each.name: _of_experiment(results, each) for each in results.experiments}
    return _rounded(numbers)


def _of_experiment(results: Results, experiment: Experiment) -> dict[str, Any]:
    immediate = experiment.immediate.groupby(["scope", "model"])["mrr"].mean()
    statistics = experiment.statistics()
    numbers: dict[str, Any] = {"immediate_mrr": _by_scope(experiment, 100 * immediate.dropna())}
    if experiment.finetuned:
        epochs = epochs_summary(experiment.convergence, ["model"])
        numbers["epochs_to_convergence"] = epochs["mean"].to_dict()
        numbers["runs_without_convergence"] = epochs["do not end"].to_dict()
    if experiment.settings.graph.extend is None:
        numbers["graph"] = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        if BASELINE in experiment.initializers:
            numbers["gain_over_xavier_percent"] = {
                model: statistics.gain(model)[0]
                for model in experiment.initializers
                if model != BASELINE
            }
    else:
        numbers["drop_percent"] = {BASELINE: statistics.drop(BASELINE)[0]}
        last = where(experiment.curves, scope="known_closed", epoch=experiment.max_epochs)
        ended = where(last, model=experiment.rows).groupby("model")["mrr"].mean()
        numbers["known_closed_at_the_end"] = (100 * ended).to_dict()
    if experiment.queries is not None:
        numbers["novel_entity_given"] = experiment.means("given")["mean"].to_dict()
    answers = answers_of(results, experiment)
    if answers:
        hits = 100 * answers.hits().groupby("model")["hit"].mean()
        numbers["affordances_percent"] = hits.to_dict()
    return numbers


def _by_scope(experiment: Experiment, values: pd.Series) -> dict[str, dict[str, float]]:
    """Values by scope and model; only scopes that have some."""
    return {
        str(scope): _by_model(experiment, values[scope]) for scope in values.index.unique("scope")
    }


def _by_model(experiment: Experiment, values: pd.Series) -> dict[str, float]:
    return dict(values.reindex(experiment.rows).dropna())


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    """Values rounded as in all files, without nulls."""
    rounded = dict[str, Any]()
    for name, value in values.items():
        if isinstance(value, dict):
            rounded[name] = _rounded(value)
        elif not pd.isna(value):
            rounded[name] = number(value) if isinstance(value, float) else value
    return rounded


#: The plots that dvc.yaml names, whichever experiments there are, with the column of x.
PLOTS = {
    **dict.fromkeys(
        [f"immediate_{scope}_{name}" for name in STANDALONE for scope in ("weighted", "novel")],
        "size",
    ),
    **dict.fromkeys(
        [f"curves_{scope}_{name}" for name in STANDALONE for scope in GROUPED]
        + [f"curves_known_{name}" for name in EXTENDED],
        "epoch",
    ),
}


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Curves for ``dvc plots``, by file name: means of MRR × 100 by size or epoch, a column for
    each initializer.
    """
    initializers = list(results.params.initializers)
    frames = {name: pd.DataFrame(columns=[x, *initializers]) for name, x in PLOTS.items()}
    for experiment in results.experiments:
        if experiment in results.standalone:
            models = list(dict.fromkeys([*sorted(experiment.rows), *initializers]))
            for scope in GROUPED:
                runs = where(experiment.immediate, scope=scope)
                frames[f"immediate_{scope}_{experiment.name}"] = _means(runs, "size", models)
        curves = where(experiment.curves, model=experiment.initializers)
        for scope in (*GROUPED, "known_closed"):
            runs = where(curves, scope=scope)
            frames[f"curves_{scope}_{experiment.name}"] = _means(runs, "epoch", initializers)
    return frames


def _means(runs: pd.DataFrame, by: str, models: Sequence[str]) -> pd.DataFrame:
    """Means of MRR (points): a row for each size or epoch, a column for each model."""
    means = 100 * runs.groupby([by, "model"])["mrr"].mean().unstack("model")
    return means.reindex(columns=list(models)).reset_index()
