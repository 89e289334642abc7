"""Train Θ⁰ on D⁰, for every size and seed."""

import pandas as pd

from isi.experiment.train import as_tensors, train_stack, warn_of_batch
from isi.tables import io
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import THETA0, TRAINING_LOG, Store


@stage
def train_theta0(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    config, compute = params.train_config(), params.compute
    grid = store.grid(stack_height(compute))
    warn_of_batch(grid[0], config)
    trained = run(
        train_stack, [(points, config) for points in grid], compute, f"{experiment}, theta0"
    )
    sizes = sorted({points.size for points in grid})
    for size in sizes:
        results = [
            (points, result)
            for points, result in zip(grid, trained, strict=True)
            if points.size == size
        ]
        THETA0.write(as_tensors(results), context.stage, experiment=experiment, size=size)
    written = [THETA0.path(experiment=experiment, size=size) for size in sizes]
    io.keep_only(written[0].parent, written)
    log = pd.concat(result.log for result in trained)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model="theta0")


if __name__ == "__main__":
    train_theta0()
