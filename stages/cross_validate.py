"""Train the joint model with several settings on all but one fold, and measure it on that."""

from __future__ import annotations

import pandas as pd

from isi import paths, tables
from isi.errors import InputError
from isi.experiments import learning
from isi.experiments.cross_validation import best_looks, fold_tasks
from isi.experiments.executor import run, stack_height
from isi.experiments.store import Store
from isi.sessions import VALID
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "embedding.dimension", "embedding.init_range", "negatives.mode", "negatives.ratio", "negatives.head_pool",
    "training.batch_size", "training.learning_rate", "training.weight_decay", "training.max_epochs",
    "training.evaluate_every", "training.patience", "cross_validation",
)  # fmt: skip
def cross_validate(params: Params, provenance: Provenance) -> None:
    """Train the joint model with several settings on all but one fold, and measure it on that."""
    tasks = fold_tasks(Store("ai2thor", provenance).graph(), params, "ai2thor", stack_height(params.compute))
    if not all((task.splits == VALID).any(1).all() for task in tasks):
        expected = "expected no more folds than triples that may leave train (some must stay, for every entity)"
        raise InputError(paths.PARAMS, "cross_validation.folds", expected)
    learned = run(learning.learn_joint, tasks, params.compute, "cross-validation")
    looks = pd.concat(best_looks(task, result) for task, result in zip(tasks, learned, strict=True))
    ordered = looks.sort_values(["dimension", "ratio", "learning_rate", "weight_decay", "fold"])
    tables.write(paths.cross_validation("ai2thor"), ordered, tables.CROSS_VALIDATION, provenance)


if __name__ == "__main__":
    cross_validate()
