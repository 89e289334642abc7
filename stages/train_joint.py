"""Train the joint models of every session, and measure each of them in all scopes of its session.

That of session 1 is measured by kind of query, too.
"""

import pandas as pd

from isi.experiment.breakdown import (
    USED_COORDINATES,
    break_down,
    used_coordinates,
    write_queries,
)
from isi.experiment.grid import JOINT_MODEL
from isi.experiment.runner import run, stack_height
from isi.experiment.store import JOINT, TRAINING_LOG, Store, write_runs
from isi.experiment.train import as_tensors, evaluate_stack, joint_tasks, train_stack, warn_of_batch
from isi.stage import StageContext, stage


@stage
def train_joint(context: StageContext, experiment: str) -> None:
    store = Store(experiment)
    config = context.params.train_config()
    compute = context.params.compute
    grid = store.grid(stack_height(compute))
    warn_of_batch(grid[0], config)
    tasks = joint_tasks(grid, config)
    trained = run(train_stack, tasks, compute, f"{experiment}, joint")
    results = [
        (points, session, result)
        for (points, _, session), result in zip(tasks, trained, strict=True)
    ]
    JOINT.write(as_tensors(results), context.stage, experiment=experiment)
    joint = [(points, store.joint_models(points, config.model)) for points in grid]
    runs = pd.concat(run(evaluate_stack, joint, compute, f"{experiment}, joint, measured"))
    log = pd.concat(result.log for _, session, result in results if not session)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model=JOINT_MODEL)
    write_runs(runs, context.stage, experiment, JOINT_MODEL)
    first = [(points, models[0], JOINT_MODEL) for points, models in joint]
    parts = pd.concat(run(break_down, first, compute, f"{experiment}, joint, queries"))
    write_queries(parts, context.stage, experiment, JOINT_MODEL)
    relation, seed = JOINT.read(["relation", "seed"], experiment=experiment).values()
    used = used_coordinates(config.model, relation, seed.tolist(), store.graph().relations)
    USED_COORDINATES.write(used, context.stage, experiment=experiment)


if __name__ == "__main__":
    train_joint()
