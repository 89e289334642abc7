"""Insert novel entities by one initializer with several indicator set sizes,
and fine-tune until convergence.
"""

import pandas as pd

from isi.analyses.finetuning import INDICATOR_SWEEP
from isi.errors import InputError
from isi.experiment.insert import insert_stack, insert_tasks
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def sweep_indicators(context: StageContext, experiment: str, initializer: str) -> None:
    params, sweep, store = context.params, context.params.sweep, Store(experiment)
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
    configs = [params.insert_config(initializer, options={**options, "k": k}) for k in sizes]
    model = params.model_of()
    tasks = [task for config in configs for task in insert_tasks(store, model, grid, config)]
    results = run(insert_stack, tasks, params.compute, f"indicator sets, {initializer}")
    runs = (
        result.runs.assign(k=task[-1].options["k"])
        for task, result in zip(tasks, results, strict=True)
    )
    INDICATOR_SWEEP.write(
        pd.concat(runs), context.stage, experiment=experiment, initializer=initializer
    )


if __name__ == "__main__":
    sweep_indicators()
