"""Insert novel entities by one initializer with several indicator set sizes,
and fine-tune until convergence.
"""

from dataclasses import replace

import pandas as pd

from isi.analyses.finetuning import INDICATOR_SWEEP
from isi.errors import InputError
from isi.experiment.insert import InsertTask, insert_stack, insert_tasks, join
from isi.tables import paths
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def sweep_indicators(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    sweep = params.sweep
    options = sweep.initializers[initializer]
    # a larger k selects all candidates
    sizes = [k for k in sweep.k if k <= options.get("candidates", k)]
    if not sizes:
        raise InputError(
            paths.PARAMS,
            "sweep.k",
            f"expected a k up to sweep.initializers.{initializer}.candidates",
        )
    grid = store.grid(stack_height(params.compute), sweep.size, sweep.seeds)
    model, tasks = params.model_of(), list[InsertTask]()
    for k in sizes:
        config = params.insert_config(initializer, options={**options, "k": k})
        config = replace(config, finetuned=sweep.finetuned_seeds)
        tasks += insert_tasks(store, model, grid, config)
    name = f"{experiment}, {initializer}"
    results = run(insert_stack, tasks, params.compute, name)
    runs = list[pd.DataFrame]()
    for place, k in enumerate(sizes):
        of_size = results[place * len(grid) : (place + 1) * len(grid)]
        runs.append(join(grid, of_size, f"{name}, k = {k}").runs.assign(k=k))
    INDICATOR_SWEEP.write(
        pd.concat(runs), context.stage, experiment=experiment, initializer=initializer
    )


if __name__ == "__main__":
    sweep_indicators()
