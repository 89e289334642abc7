"""Train the joint model with several settings on all but one fold, and measure it on that."""

from __future__ import annotations

import pandas as pd

from isi.analyses.cross_validation import CROSS_VALIDATION, CrossValidationFactors, best_looks, fold_tasks
from isi.errors import InputError
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import train_config, train_joint_model
from isi.graph.sessions import VALID
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def cross_validate(given: StageContext, experiment: str) -> None:
    """Train the joint model with several settings on all but one fold, and measure it on that."""
    study, compute = given.section("cross_validation", CrossValidationFactors), compute_of(given)
    graph = Store(experiment).graph()
    tasks = fold_tasks(experiment, graph, study, train_config(given), stack_height(compute))
    if not all((task.points.splits == VALID).any(1).all() for task in tasks):
        expected = "expected no more folds than triples that may leave train (some must stay, for every entity)"
        raise InputError(paths.PARAMS, "cross_validation.folds", expected)
    learned = run(train_joint_model, tasks, compute, "cross-validation")
    looks = pd.concat(best_looks(task, result) for task, result in zip(tasks, learned, strict=True))
    CROSS_VALIDATION.write(looks, given.stage, experiment=experiment)


if __name__ == "__main__":
    cross_validate()
