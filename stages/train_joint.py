"""Train the joint models of D¹, and measure them in all scopes, and by kind of query."""

import pandas as pd

from isi.evaluation.changes import change_rows, with_weighted_changes
from isi.evaluation.query_sets import with_weighted
from isi.evaluation.scopes import SCOPES
from isi.experiment.train import (
    as_tensors,
    evaluate_stack,
    joint_points,
    train_stack,
    warn_of_batch,
)
from isi.tables.table import concat
from stages.breakdown import break_down, write_queries
from stages.grid import JOINT_MODEL, known_shares
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import JOINT, MEASURE_CHANGES, RUNS, TRAINING_LOG, Store


@stage
def train_joint(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    config, compute = params.train_config(), params.compute
    grid = store.grid(stack_height(compute))
    shares = known_shares(grid)
    names = {"experiment": experiment, "model": JOINT_MODEL}
    warn_of_batch(grid[0], config)
    of_joint = joint_points(grid, store.shares_split)
    tasks = [(points, config) for points in of_joint]
    trained = run(train_stack, tasks, compute, f"{experiment}, joint")
    JOINT.write(as_tensors(zip(of_joint, trained, strict=True)), context.stage, **names)
    TRAINING_LOG.write(pd.concat([each.log for each in trained]), context.stage, **names)
    joint = [(points, store.joint(points, config.model)) for points in grid]
    with_changes = experiment in params.measure_changes.experiments
    measured = pd.concat(
        run(
            evaluate_stack,
            [(*each, with_changes) for each in joint],
            compute,
            f"{experiment}, joint, measured",
        )
    )
    runs = measured[measured["scope"].isin(list(SCOPES))]
    RUNS.write(with_weighted(runs, shares), context.stage, **names)
    changes = concat(list[pd.DataFrame](), MEASURE_CHANGES)
    if with_changes:
        changes = with_weighted_changes(change_rows(measured), shares)
    MEASURE_CHANGES.write(changes, context.stage, **names)
    first = [(points, models[0], JOINT_MODEL) for points, models in joint]
    parts = pd.concat(run(break_down, first, compute, f"{experiment}, joint, queries"))
    write_queries(parts, context.stage, experiment, JOINT_MODEL)


if __name__ == "__main__":
    train_joint()
