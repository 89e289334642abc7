"""Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""

from dataclasses import replace

import pandas as pd

from isi.analyses.sweep import INDICATOR_SWEEP
from isi.errors import InputError
from isi.experiment.insert import insert_config, insert_stack, insertion_tasks
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def sweep_indicators(context: StageContext, experiment: str, initializer: str) -> None:
    """Insert novel entities with indicator sets of several sizes, by one initializer, until convergence."""
    params, sweep, store = context.params, context.params.sweep, Store(experiment)
    options = sweep.initializers[initializer]
    sizes = [k for k in sweep.k if k <= options.get("candidates", k)]  # ERS chooses among these: more are the same set
    if not sizes:
        raise InputError(paths.PARAMS, "sweep.k", f"expected a size up to sweep.initializers.{initializer}.candidates")
    grid = store.grid(stack_height(params.compute), sweep.size, sweep.seeds)
    config = insert_config(params, initializer, options={**options, "k": sizes[0]})
    first = insertion_tasks(store, params, config, grid)
    tasks = [replace(task, config=replace(config, options={**options, "k": k})) for k in sizes for task in first]
    results = run(insert_stack, tasks, params.compute, f"indicator sets, {initializer}")
    runs = (result.runs.assign(k=task.config.options["k"]) for task, result in zip(tasks, results, strict=True))
    INDICATOR_SWEEP.write(pd.concat(runs), context.stage, experiment=experiment, initializer=initializer)


if __name__ == "__main__":
    sweep_indicators()
