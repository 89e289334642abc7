"""Train the joint model with several settings on all but one fold, and measure it on that."""

from __future__ import annotations

import pandas as pd

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import learn_joint, learning
from isi.experiments.store import Store
from isi.sessions.session import VALID
from isi.studies.cross_validation import Factors, best_looks, fold_tasks


@stage
def cross_validate(given: Given, experiment: str) -> None:
    """Train the joint model with several settings on all but one fold, and measure it on that."""
    study, compute = given.section("cross_validation", Factors), compute_of(given)
    graph = Store(experiment, given.provenance).graph()
    tasks = fold_tasks(experiment, graph, study, learning(given), stack_height(compute))
    if not all((task.cells.splits == VALID).any(1).all() for task in tasks):
        expected = "expected no more folds than triples that may leave train (some must stay, for every entity)"
        raise InputError(paths.PARAMS, "cross_validation.folds", expected)
    learned = run(learn_joint, tasks, compute, "cross-validation")
    looks = pd.concat(best_looks(task, result) for task, result in zip(tasks, learned, strict=True))
    ordered = looks.sort_values(["dimension", "ratio", "learning_rate", "weight_decay", "fold"])
    tables.write(paths.cross_validation(experiment), ordered, tables.CROSS_VALIDATION, given.provenance)


if __name__ == "__main__":
    cross_validate()
