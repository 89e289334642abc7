"""Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi import paths, tables
from isi.errors import InputError
from isi.experiments import insertion
from isi.experiments.executor import run, stack_height
from isi.experiments.store import Store
from isi.experiments.tasks import insertion_tasks
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "sweep.k", "sweep.size", "sweep.seeds", "initializers.ers.candidates", argument="initializer",
)  # fmt: skip
def sweep_indicators(params: Params, provenance: Provenance, initializer: str) -> None:
    """Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""
    how, most = params.sweep, params.initializers.options(initializer).get("candidates", max(params.sweep.k))
    sizes = [k for k in how.k if k <= most]  # ERS chooses among its candidates: more are the same set
    if not sizes:
        raise InputError(paths.PARAMS, "sweep.k", f"expected a size up to initializers.{initializer}.candidates")
    store = Store("ai2thor", provenance)
    tasks = insertion_tasks(store, params, initializer, store.cells(stack_height(params.compute), how.size, how.seeds))
    swept = [replace(task, options=task.options | {"k": k}) for k in sizes for task in tasks]
    done = run(insertion.insert, swept, params.compute, f"indicator sets, {initializer}")
    runs = pd.concat(result.runs.assign(k=task.options["k"]) for task, result in zip(swept, done, strict=True))
    runs = runs.sort_values(["k", "size", "seed", "epoch", "scope"])
    tables.write(paths.indicator_sweep(initializer), runs, tables.INDICATOR_SWEEP, provenance)


if __name__ == "__main__":
    sweep_indicators()
