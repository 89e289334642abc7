"""Train Θ⁰ on D⁰, for every size and seed."""

from __future__ import annotations

import pandas as pd

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import LearningTask, as_tensors, learn_initial, learning
from isi.experiments.store import Store


@stage
def train_theta0(given: Given, experiment: str) -> None:
    """Train Θ⁰ on D⁰, for every size and seed."""
    store, how, compute = Store(experiment, given.provenance), learning(given), compute_of(given)
    tasks = [LearningTask(cells, how) for cells in store.cells(stack_height(compute))]
    learned = run(learn_initial, tasks, compute, f"{experiment}, theta0")
    files = {}
    for size in sorted({task.cells.size for task in tasks}):
        of_size = [number for number, task in enumerate(tasks) if task.cells.size == size]
        tensors = as_tensors([tasks[n] for n in of_size], [learned[n] for n in of_size])
        files[paths.theta0(experiment, size)] = tensors
    for path, tensors in files.items():
        tables.write_tensors(path, tensors, given.provenance)
    tables.keep_only(next(iter(files)).parent, list(files))
    store.write_log("theta0", pd.concat(result.log for result in learned))


if __name__ == "__main__":
    train_theta0()
