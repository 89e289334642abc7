"""Train the joint model of every seed on all that has a split, and measure it in the scopes of every size."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.experiment.grid import NO_INSERTION, StackedVectors
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store, write_runs
from isi.experiment.tables import JOINT, TRAINING_LOG
from isi.experiment.train import EvaluationTask, TrainTask, as_tensors, evaluate_stack, train_config, train_joint_model
from isi.stage import StageContext, stage


@stage
def train_joint(context: StageContext, experiment: str) -> None:
    """Train the joint model of every seed on all that has a split, and measure it in the scopes of every size."""
    store, config, compute = Store(experiment), train_config(context.params), context.params.compute
    grid, insert_triples = store.grid(stack_height(compute)), store.insert_triples()
    tasks = [
        TrainTask(replace(points, size=NO_INSERTION, novel=points.novel[:, :0]), config)
        for points in grid
        if points.size == grid[0].size  # once for each seed
    ]
    trained = run(train_joint_model, tasks, compute, f"{experiment}, joint")
    tensors = as_tensors(tasks, trained)
    row = {seed: number for number, seed in enumerate(tensors["seed"].tolist())}
    evaluations = []
    for points in grid:
        rows = [row[seed] for seed in points.seeds]
        theta = StackedVectors(config.model, tensors["entity"][rows].numpy(), tensors["relation"][rows].numpy())
        evaluations.append(EvaluationTask(points, theta, store.insert_triples_of(points, insert_triples)))
    runs = pd.concat(run(evaluate_stack, evaluations, compute, f"{experiment}, joint, measured"))
    log = pd.concat(result.log for result in trained)
    JOINT.write(tensors, context.stage, experiment=experiment)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model="joint")
    write_runs(runs, context.stage, experiment, "joint")


if __name__ == "__main__":
    train_joint()
