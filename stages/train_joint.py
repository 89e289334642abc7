"""Train the joint models of every session, and measure each in the scopes of its session."""

import pandas as pd

from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store, write_runs
from isi.experiment.tables import JOINT, TRAINING_LOG
from isi.experiment.train import (
    EvaluationTask,
    evaluate_stack,
    joint_tasks,
    joint_tensors,
    joint_vectors,
    train_config,
    train_stack,
)
from isi.stage import StageContext, stage


@stage
def train_joint(context: StageContext, experiment: str) -> None:
    """Train the joint models of every session, and measure each in the scopes of its session."""
    store, config, compute = Store(experiment), train_config(context.params), context.params.compute
    grid, insert_triples = store.grid(stack_height(compute)), store.insert_triples()
    tasks = joint_tasks(grid, config)
    trained = run(train_stack, tasks, compute, f"{experiment}, joint")
    tensors = joint_tensors(tasks, trained)
    evaluations = [
        EvaluationTask(
            points, joint_vectors(tensors, config.model, points), store.insert_triples_of(points, insert_triples)
        )
        for points in grid
    ]
    runs = pd.concat(run(evaluate_stack, evaluations, compute, f"{experiment}, joint, measured"))
    log = pd.concat(result.log for task, result in zip(tasks, trained, strict=True) if not task.session)
    JOINT.write(tensors, context.stage, experiment=experiment)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model="joint")
    write_runs(runs, context.stage, experiment, "joint")


if __name__ == "__main__":
    train_joint()
