"""Train the joint models of D¹, and measure them in all scopes, and by kind of query."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from isi.config import Study
from isi.evaluation.changes import change_rows, with_weighted_changes
from isi.evaluation.query_sets import with_weighted
from isi.evaluation.ranking import MEASURES, Result, evaluate, measure_rows
from isi.evaluation.scopes import SCOPES
from isi.models.stack import Embedding
from isi.tables.table import concat
from stages.breakdown import break_down, write_queries
from stages.grid import JOINT_MODEL, GridPoints, known_shares
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import JOINT, MEASURE_CHANGES, RUNS, TRAINING_LOG, Store
from stages.train_theta0 import as_tensors, train_config, train_stack, warn_of_batch

#: Number of joint models whose measures are averaged where all seeds share one split, as the
#: paper's authors do.
JOINT_MODELS = 5


@stage
def train_joint(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    config, compute = train_config(params), params.read("compute", Compute)
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
    with_changes = experiment in params.read("measure_changes", Study).experiments
    measuring = [(points, models, with_changes) for points, models in joint]
    measured = pd.concat(run(evaluate_stack, measuring, compute, f"{experiment}, joint, measured"))
    runs = measured[measured["scope"].isin(list(SCOPES))]
    RUNS.write(with_weighted(runs, shares), context.stage, **names)
    changes = concat(list[pd.DataFrame](), MEASURE_CHANGES)
    if with_changes:
        changes = with_weighted_changes(change_rows(measured), shares)
    MEASURE_CHANGES.write(changes, context.stage, **names)
    first = [(points, models[0], JOINT_MODEL) for points, models in joint]
    parts = pd.concat(run(break_down, first, compute, f"{experiment}, joint, queries"))
    write_queries(parts, context.stage, experiment, JOINT_MODEL)


def joint_points(grid: Sequence[GridPoints], shares_split: bool) -> list[GridPoints]:
    """Points at which the joint models are trained: those of every seed, for all sizes; or those
    of the first seeds, where all share one split.
    """
    of_seeds = [points.all_known for points in grid if points.size == grid[0].size]
    if not shares_split:
        return of_seeds
    first = of_seeds[0]
    seeds = [seed for points in of_seeds for seed in points.seeds][:JOINT_MODELS]
    splits = np.repeat(first.splits[:1], len(seeds), 0)
    novel = first.novel[:1].repeat(len(seeds), 0)
    return [replace(first, seeds=seeds, splits=splits, novel=novel)]


def evaluate_stack(
    points: GridPoints, joint: Sequence[Embedding], with_changes: bool = False
) -> pd.DataFrame:
    """Measures of joint models on D¹ in all query sets (``RUNS``, epoch 0), the mean over models;
    ``with_changes``: in those of changes of the measure, too.
    """
    query_sets = points.measured_sets(with_changes)
    frames = list[pd.DataFrame]()
    for theta in joint:
        results = dict[str, Result]()
        for sharing_triples in query_sets:
            results |= evaluate(theta, sharing_triples)
        frames.append(points.run_rows([measure_rows(results)]))
    measured, mean = frames[0], sum(frame[list(MEASURES)].to_numpy() for frame in frames)
    measured[list(MEASURES)] = mean / len(frames)
    return measured


if __name__ == "__main__":
    train_joint()
