"""Train Θ⁰ on D⁰, for every size and seed."""

import pandas as pd

from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import THETA0, TRAINING_LOG
from isi.experiment.train import TrainTask, as_tensors, train_config, train_stack
from isi.stage import StageContext, stage
from isi.tables import io


@stage
def train_theta0(context: StageContext, experiment: str) -> None:
    """Train Θ⁰ on D⁰, for every size and seed."""
    store, config, compute = Store(experiment), train_config(context.params), context.params.compute
    tasks = [TrainTask(points, config) for points in store.grid(stack_height(compute))]
    trained = run(train_stack, tasks, compute, f"{experiment}, theta0")
    sizes = sorted({task.points.size for task in tasks})
    for size in sizes:
        numbers = [number for number, task in enumerate(tasks) if task.points.size == size]
        tensors = as_tensors([tasks[number] for number in numbers], [trained[number] for number in numbers])
        THETA0.write(tensors, context.stage, experiment=experiment, size=size)
    written = [THETA0.path(experiment=experiment, size=size) for size in sizes]
    io.keep_only(written[0].parent, written)
    log = pd.concat(result.log for result in trained)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model="theta0")


if __name__ == "__main__":
    train_theta0()
