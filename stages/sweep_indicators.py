"""Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.analyses.sweep import INDICATOR_SWEEP, SweepSettings
from isi.errors import InputError
from isi.experiment.insert import insert_stack, inserting_with, insertion_tasks
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def sweep_indicators(given: StageContext, experiment: str, initializer: str) -> None:
    """Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""
    how = given.section("sweep", SweepSettings)
    options, compute = how.initializers[initializer], compute_of(given)
    key = f"sweep.initializers.{initializer}"
    sizes = [k for k in how.k if k <= options.get("candidates", k)]  # ERS chooses among these: more are the same set
    if not sizes:
        raise InputError(paths.PARAMS, "sweep.k", f"expected a size up to {key}.candidates")
    store = Store(experiment)
    grid = store.grid(stack_height(compute), how.size, how.seeds)
    first = insertion_tasks(store, given, inserting_with(given, initializer, {**options, "k": sizes[0]}, key), grid)
    swept = [replace(task, how=replace(task.how, options={**options, "k": k})) for k in sizes for task in first]
    done = run(insert_stack, swept, compute, f"indicator sets, {initializer}")
    runs = pd.concat(result.runs.assign(k=task.how.options["k"]) for task, result in zip(swept, done, strict=True))
    INDICATOR_SWEEP.write(runs, given.stage, experiment=experiment, initializer=initializer)


if __name__ == "__main__":
    sweep_indicators()
