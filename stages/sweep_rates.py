"""Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""

from isi.analyses.sweep import RATE_SWEEP
from isi.experiment.insert import insert_config, insert_stack, insertion_tasks
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables.table import concat


@stage
def sweep_rates(context: StageContext, experiment: str, initializer: str) -> None:
    """Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""
    params, store, config = context.params, Store(experiment), insert_config(context.params, initializer)
    grid, tasks, factors = store.grid(stack_height(params.compute), params.rate_sweep.size), [], list[float]()
    for factor in params.rate_sweep.factors:
        at_rate = config.training(learning_rate=factor * config.optimizer.learning_rate)
        tasks += insertion_tasks(store, params, at_rate, grid)
        factors += [factor] * len(grid)
    results = run(insert_stack, tasks, params.compute, f"rates, {initializer}")
    runs = (result.runs.assign(factor=factor) for factor, result in zip(factors, results, strict=True))
    RATE_SWEEP.write(concat(runs, RATE_SWEEP), context.stage, experiment=experiment, initializer=initializer)


if __name__ == "__main__":
    sweep_rates()
