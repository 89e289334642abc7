"""Headline numbers for ``dvc metrics``, and curves for ``dvc plots``."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from isi.evaluation.query_sets import CONVERGING
from isi.report.tables.data import BASELINE, JOINT, Experiment, Results
from isi.report.tables.estimates import drops, improvements, where
from isi.report.tables.forms import csv, number
from isi.report.tables.registry import write as write_tables
from isi.report.tables.results import TOP, answers_of
from isi.tables.io import atomically, keep_only

#: The headline numbers, beside the page.
METRICS = "metrics.json"


def write(results: Results, folder: Path) -> None:
    """Write all tables of the first pipeline, its plots and its headline numbers."""
    write_tables("report", results, folder / "tables")
    written = list[Path]()
    for name, frame in plots(results).items():
        path = folder / "plots" / f"{name}.csv"
        atomically(path, partial(Path.write_bytes, data=csv(frame).encode()))
        written.append(path)
    keep_only(folder / "plots", written)
    text = json.dumps(metrics(results), indent=2)
    atomically(folder / METRICS, partial(Path.write_bytes, data=f"{text}\n".encode()))


def metrics(results: Results) -> dict[str, Any]:
    """Headline numbers: the first experiment's, and each other one's under its name."""
    first, *others = results.experiments
    numbers = _of_experiment(results, first)
    numbers |= {other.name: _of_experiment(results, other) for other in others}
    return _rounded(numbers)


def _of_experiment(results: Results, experiment: Experiment) -> dict[str, Any]:
    epochs = {scope: _by_model(experiment, experiment.epochs(scope)) for scope in CONVERGING}
    never = 1 - experiment.convergence.groupby(["scope", "model"])["converged"].mean()
    means = experiment.immediate.groupby(["scope", "model"])["mrr_star"].mean().dropna()
    numbers: dict[str, Any] = {
        "immediate_mrr_star": {
            scope: _by_model(experiment, 100 * means[scope])
            for scope in means.index.unique("scope")
        },
        "epochs_to_convergence": {
            scope: of_scope for scope, of_scope in epochs.items() if of_scope
        },
        "unconverged_percent": {
            scope: _by_model(experiment, 100 * never[scope])
            for scope in never.index.unique("scope")
        },
    }
    if experiment.settings.graph.extend is None:
        graph = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        gains = {
            scope: improvements(experiment.immediate, scope)["gain"].drop(
                [BASELINE, JOINT], errors="ignore"
            )
            for scope in ("all", "novel")
        }
        shown = {scope: _by_model(experiment, gain) for scope, gain in gains.items()}
        numbers = {"graph": graph, **numbers, "improvement_over_xavier_percent": shown}
    else:
        last = where(experiment.curves, scope="known_closed", epoch=experiment.max_epochs)
        last = where(last, model=experiment.rows)
        numbers["drop_percent"] = drops(experiment.immediate)["drop"].to_dict()
        ended = 100 * last.groupby("model")["mrr_star"].mean()
        numbers["known_closed_at_the_end"] = ended.to_dict()
    if experiment.queries is not None:
        numbers["novel_entity_given"] = experiment.means("given")["mean"].to_dict()
    answers = answers_of(results)
    if answers.experiment is experiment:
        ranks = answers.ranks[answers.ranks["rank"] <= TOP]
        hits = ranks["answer"].map(answers.entities["kind"]).isin(answers.kinds)
        numbers["affordances_percent"] = (100 * hits.groupby(ranks["model"]).mean()).to_dict()
    return numbers


def _by_model(experiment: Experiment, values: pd.Series) -> dict[str, float]:
    present = [name for name in experiment.rows if name in values.index]
    return {name: float(values[name]) for name in present}


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
            groups = experiment.immediate.groupby(["scope", "size", "model"])
            means = 100 * groups["mrr_star"].mean().unstack("model")
            means = means.reindex(columns=list(dict.fromkeys([*means.columns, *initializers])))
            for scope in ("all", "novel"):
                rows = means[means.index.get_level_values("scope") == scope]
                frames[f"immediate_{scope}{experiment.suffix}"] = rows.droplevel(0).reset_index()
            name = f"curves_{{}}{experiment.suffix}"
        runs = where(experiment.curves, model=experiment.initializers)
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            groups = where(runs, scope=scope).groupby(["epoch", "model"])
            rows = 100 * groups["mrr_star"].mean().unstack("model").reindex(columns=initializers)
            frames[name.format(scope)] = rows.reset_index()
    return frames
