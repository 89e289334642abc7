"""For every fold and each of several settings, train a joint model on the other folds,
and measure it on the fold.
"""

import pandas as pd

from isi.analyses.joint_models import (
    CROSS_VALIDATION,
    best_validations,
    changed_config,
    fold_points,
)
from isi.experiment.train import train_stack
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def cross_validate(context: StageContext, experiment: str) -> None:
    params, graph = context.params.of(experiment), Store(experiment).graph()
    config = params.train_config()
    number, height = params.cross_validation.folds, stack_height(params.compute)
    grid = fold_points(experiment, graph, params.seed, number, height)
    cases = [(points, setting) for setting in params.settings for points in grid]
    tasks = [(points, changed_config(config, setting)) for points, setting in cases]
    trained = run(train_stack, tasks, params.compute, "cross-validation")
    best = pd.concat(
        best_validations(result, setting)
        for (_, setting), result in zip(cases, trained, strict=True)
    )
    CROSS_VALIDATION.write(best, context.stage, experiment=experiment)


if __name__ == "__main__":
    cross_validate()
