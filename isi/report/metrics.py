"""Headline numbers for ``dvc metrics`` and curves for ``dvc plots``, MRR* in points."""

from __future__ import annotations

from typing import Any

import pandas as pd

from isi.report import transfer
from isi.report.results import JOINT, Experiment, Results
from isi.report.tables import improvement_over_xavier

Numbers = dict[str, Any]


def metrics(results: Results) -> Numbers:
    """The headline numbers of both experiments."""
    return {
        "graph": {
            "observations": int(results.triples["count"].sum()),
            "unique_triples": len(results.triples),
            "entities": len(results.entities),
        },
        **_of_experiment(results),
        "improvement_over_xavier_percent": {
            scope: {name: round(value, 6) for name, value in improvement_over_xavier(results, scope).items()
                    if name not in ("xavier", JOINT)}
            for scope in ("all", "novel")
        },
        "transfer": {
            **_of_experiment(results.transfer),
            "drop_percent": _rounded(transfer.drop(results)),
            "known_closed_at_the_end": _rounded(transfer.known_closed_at_the_end(results)),
            "affordances_percent": _rounded(transfer.shares(results)),
        },
    }  # fmt: skip


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Means over seeds, one column a model."""
    means = 100 * results.at_once.groupby(["scope", "size", "model"])["mrr_star"].mean().unstack("model")
    frames = {f"immediate_{scope}": means.loc[scope].reset_index() for scope in ("all", "novel")}
    followed = {"curves": (results, results.curve_size), "transfer": (results.transfer, results.params.transfer.size)}
    for name, (experiment, size) in followed.items():
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            frames[f"{name}_{scope}"] = _curves(experiment, size, scope)
    return frames


def _curves(experiment: Experiment, size: int | None, scope: str) -> pd.DataFrame:
    runs = experiment.runs
    own = runs[(runs["size"] == size) & (runs["scope"] == scope) & (runs["model"] != JOINT)]
    if own.empty:
        return pd.DataFrame(columns=["epoch", *experiment.initializers])
    return (100 * own.groupby(["epoch", "model"])["mrr_star"].mean().unstack("model")).reset_index()


def _of_experiment(experiment: Experiment) -> Numbers:
    at_once = 100 * experiment.at_once.groupby(["scope", "model"])["mrr_star"].mean().dropna()
    cells = experiment.convergence.groupby(["scope", "model"])
    never = 100 * (1 - cells["converged"].mean())
    columns = {"immediate_mrr_star": at_once, "epochs_to_convergence": cells["epochs"].mean(),
               "unconverged_percent": never}  # fmt: skip
    return {name: _by_scope(values, experiment.models) for name, values in columns.items()}


def _by_scope(values: pd.Series, models: list[str]) -> dict[str, dict[str, float]]:
    return {
        str(scope): {model: round(float(values[scope, model]), 6) for model in models if (scope, model) in values.index}
        for scope in values.index.unique("scope")
    }


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 6) for name, value in values.items()}
