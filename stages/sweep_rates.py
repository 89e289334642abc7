"""Insert novel entities by one initializer,
and fine-tune until convergence at several learning rates.
"""

import pandas as pd

from isi.analyses.finetuning import RATE_SWEEP
from isi.experiment.insert import insert_stack, insert_tasks
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage


@stage
def sweep_rates(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params, Store(experiment)
    config, model = params.insert_config(initializer), params.model_of()
    grid = store.grid(stack_height(params.compute), params.rate_sweep.size)
    rate = config.optimizer.learning_rate
    factors = [factor for factor in params.rate_sweep.factors for _ in grid]
    tasks = [
        task
        for factor in params.rate_sweep.factors
        for task in insert_tasks(store, model, grid, config.training(learning_rate=factor * rate))
    ]
    results = run(insert_stack, tasks, params.compute, f"rates, {initializer}")
    runs = (
        result.runs.assign(factor=factor) for factor, result in zip(factors, results, strict=True)
    )
    RATE_SWEEP.write(pd.concat(runs), context.stage, experiment=experiment, initializer=initializer)


if __name__ == "__main__":
    sweep_rates()
