"""Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.store import Store
from isi.insertion.tasks import insert, inserting_with, insertion_tasks
from isi.studies.sweeps import Indicators


@stage
def sweep_indicators(given: Given, experiment: str, initializer: str) -> None:
    """Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""
    how = given.section("sweep", Indicators)
    options, compute = how.initializers[initializer], compute_of(given)
    key = f"sweep.initializers.{initializer}"
    sizes = [k for k in how.k if k <= options.get("candidates", k)]  # ERS chooses among these: more are the same set
    if not sizes:
        raise InputError(paths.PARAMS, "sweep.k", f"expected a size up to {key}.candidates")
    store = Store(experiment, given.provenance)
    cells = store.cells(stack_height(compute), how.size, how.seeds)
    first = insertion_tasks(store, given, inserting_with(given, initializer, {**options, "k": sizes[0]}, key), cells)
    swept = [replace(task, how=replace(task.how, options={**options, "k": k})) for k in sizes for task in first]
    done = run(insert, swept, compute, f"indicator sets, {initializer}")
    runs = pd.concat(result.runs.assign(k=task.how.options["k"]) for task, result in zip(swept, done, strict=True))
    runs = runs.sort_values(["k", "size", "seed", "session", "epoch", "scope"])
    tables.write(paths.indicator_sweep(experiment, initializer), runs, tables.INDICATOR_SWEEP, given.provenance)


if __name__ == "__main__":
    sweep_indicators()
