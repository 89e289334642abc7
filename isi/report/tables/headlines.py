"""Headline numbers for ``dvc metrics``, and curves for ``dvc plots``."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from isi.report.tables import registry
from isi.report.tables.data import BASELINE, JOINT, Experiment, Results
from isi.report.tables.estimates import Names, drops, improvements, where
from isi.report.tables.forms import csv, number
from isi.report.tables.results import answers_of
from isi.tables.io import atomically

#: The headline numbers, beside the page.
METRICS = "metrics.json"


def write(results: Results, folder: Path) -> None:
    """Write all tables of the first pipeline, its plots and its headline numbers."""
    registry.write("report", results, folder / "tables")
    texts = {f"{name}.csv": csv(frame) for name, frame in plots(results).items()}
    registry.write_files(folder / "plots", texts)
    text = json.dumps(metrics(results), indent=2)
    atomically(folder / METRICS, partial(Path.write_bytes, data=f"{text}\n".encode()))


def metrics(results: Results) -> dict[str, Any]:
    """Headline numbers: the first experiment's, and each other one's under its name."""
    first, *others = results.experiments
    numbers = _of_experiment(results, first)
    numbers |= {other.name: _of_experiment(results, other) for other in others}
    return _rounded(numbers)


def _of_experiment(results: Results, experiment: Experiment) -> dict[str, Any]:
    immediate = experiment.immediate.groupby(["scope", "model"])["mrr_star"].mean()
    converged = experiment.convergence.groupby(["scope", "model"])
    numbers: dict[str, Any] = {
        "immediate_mrr_star": _by_scope(experiment, 100 * immediate.dropna()),
        "epochs_to_convergence": _by_scope(experiment, converged["epochs"].mean()),
        "unconverged_percent": _by_scope(experiment, 100 * (1 - converged["converged"].mean())),
    }
    if experiment.settings.graph.extend is None:
        graph = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        gains = dict[str, Any]()
        for scope in ("all", "novel"):
            gain = improvements(experiment.immediate, scope)["gain"]
            gains[scope] = _by_model(experiment, gain.drop([BASELINE, JOINT], errors="ignore"))
        numbers = {"graph": graph, **numbers, "improvement_over_xavier_percent": gains}
    else:
        last = where(experiment.curves, scope="known_closed", epoch=experiment.max_epochs)
        last = where(last, model=experiment.rows)
        numbers["drop_percent"] = drops(experiment.immediate)["drop"].to_dict()
        ended = 100 * last.groupby("model")["mrr_star"].mean()
        numbers["known_closed_at_the_end"] = ended.to_dict()
    if experiment.queries is not None:
        numbers["novel_entity_given"] = experiment.means("given")["mean"].to_dict()
    answers = answers_of(results)
    if answers and answers.experiment is experiment:
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


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Curves for ``dvc plots``, by file name: means of MRR* × 100 by size or epoch, a column for
    each initializer.
    """
    initializers = list(results.params.initializers)
    # dvc.yaml names these plots, also without the experiment
    nothing = pd.DataFrame(columns=["epoch", *initializers])
    frames = {"transfer_known": nothing, "transfer_known_closed": nothing}
    for experiment in results.experiments:
        name = f"{experiment.name}_{{}}"
        if experiment in results.standalone:
            models = list(dict.fromkeys([*sorted(experiment.rows), *initializers]))
            for scope in ("all", "novel"):
                runs = where(experiment.immediate, scope=scope)
                frames[f"immediate_{scope}{experiment.suffix}"] = _means(runs, "size", models)
            name = f"curves_{{}}{experiment.suffix}"
        curves = where(experiment.curves, model=experiment.initializers)
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            runs = where(curves, scope=scope)
            frames[name.format(scope)] = _means(runs, "epoch", initializers)
    return frames


def _means(runs: pd.DataFrame, by: str, models: Names) -> pd.DataFrame:
    """Means of MRR* (points): a row for each size or epoch, a column for each model."""
    means = 100 * runs.groupby([by, "model"])["mrr_star"].mean().unstack("model")
    return means.reindex(columns=list(models)).reset_index()
