"""Train Θ⁰ on D⁰, for every size and seed."""

from __future__ import annotations

import pandas as pd

from isi import paths, tables
from isi.experiments import learning
from isi.experiments.executor import run, stack_height
from isi.experiments.learning import Learning, LearningTask
from isi.experiments.store import Store, write_log
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "embedding.dimension", "embedding.init_range", "negatives.mode", "negatives.ratio", "negatives.head_pool",
    "training.batch_size", "training.learning_rate", "training.weight_decay", "training.max_epochs",
    "training.evaluate_every", "training.patience", argument="experiment",
)  # fmt: skip
def train_theta0(params: Params, provenance: Provenance, experiment: str) -> None:
    """Train Θ⁰ on D⁰, for every size and seed."""
    how = Learning(params.seed, params.embedding, params.negatives, params.training)
    cells = Store(experiment, provenance).cells(stack_height(params.compute))
    tasks = [LearningTask(**vars(cell), learning=how) for cell in cells]
    learned = run(learning.learn_initial, tasks, params.compute, "theta0")
    files = {}
    for size in sorted({task.size for task in tasks}):
        of_size = [number for number, task in enumerate(tasks) if task.size == size]
        tensors = learning.as_tensors([tasks[n] for n in of_size], [learned[n] for n in of_size])
        files[paths.theta0(experiment, size)] = tensors
    for path, tensors in files.items():
        tables.write_tensors(path, tensors, provenance)
    tables.keep_only(next(iter(files)).parent, list(files))
    write_log(experiment, "theta0", pd.concat(result.log for result in learned), provenance)


if __name__ == "__main__":
    train_theta0()
