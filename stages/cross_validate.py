"""Train the joint model with several settings on all but one fold, and measure it on that."""

import pandas as pd

from isi.analyses.cross_validation import CROSS_VALIDATION, best_looks, fold_tasks
from isi.errors import InputError
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import train_config, train_stack
from isi.graph.sessions import VALID
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def cross_validate(context: StageContext, experiment: str) -> None:
    """Train the joint model with several settings on all but one fold, and measure it on that."""
    params, graph = context.params, Store(experiment).graph()
    height = stack_height(params.compute)
    tasks = fold_tasks(experiment, graph, params.cross_validation, train_config(params), height)
    if not all((task.points.splits == VALID).any(1).all() for task in tasks):
        expected = "expected no more folds than triples that may leave train (some must stay, for every entity)"
        raise InputError(paths.PARAMS, "cross_validation.folds", expected)
    trained = run(train_stack, tasks, params.compute, "cross-validation")
    looks = pd.concat(best_looks(task, result) for task, result in zip(tasks, trained, strict=True))
    CROSS_VALIDATION.write(looks, context.stage, experiment=experiment)


if __name__ == "__main__":
    cross_validate()
