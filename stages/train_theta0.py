"""Train Θ⁰ on D⁰, for every size and seed."""

from __future__ import annotations

import pandas as pd

from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import THETA0, TRAINING_LOG
from isi.experiment.train import TrainTask, as_tensors, train_config, train_initial
from isi.stage import StageContext, stage
from isi.tables import io


@stage
def train_theta0(given: StageContext, experiment: str) -> None:
    """Train Θ⁰ on D⁰, for every size and seed."""
    store, how, compute = Store(experiment), train_config(given), compute_of(given)
    tasks = [TrainTask(points, how) for points in store.grid(stack_height(compute))]
    learned = run(train_initial, tasks, compute, f"{experiment}, theta0")
    files = {}
    for size in sorted({task.points.size for task in tasks}):
        of_size = [number for number, task in enumerate(tasks) if task.points.size == size]
        tensors = as_tensors([tasks[n] for n in of_size], [learned[n] for n in of_size])
        files[size] = tensors
    for size, tensors in files.items():
        THETA0.write(tensors, given.stage, experiment=experiment, size=size)
    written = [THETA0.path(experiment=experiment, size=size) for size in files]
    io.keep_only(written[0].parent, written)
    log = pd.concat(result.log for result in learned)
    TRAINING_LOG.write(log, given.stage, experiment=experiment, model="theta0")


if __name__ == "__main__":
    train_theta0()
