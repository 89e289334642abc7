"""Train the joint model of one embedding family, and measure it over all queries."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.analyses.model_comparison import MODEL_COMPARISON, ModelTask, ModelTraining, measure, rows
from isi.config import Count
from isi.experiment.grid import NO_INSERTION, StackedVectors
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import TrainTask, train_config, train_joint_model
from isi.stage import StageContext, stage


@stage
def compare_families(given: StageContext, experiment: str, family: str) -> None:
    """Train the joint model of one embedding family, and measure it over all queries."""
    trained, compute = given.section(f"compare_families.families.{family}", ModelTraining), compute_of(given)
    store = Store(experiment)
    first = store.grid(stack_height(compute), seeds=given.section("compare_families.seeds", Count))
    grid = [
        replace(points, size=NO_INSERTION, novel=points.novel[:, :0])
        for points in first
        if points.size == first[0].size
    ]
    how = train_config(given, family, **trained.model_dump())
    learned = run(train_joint_model, [TrainTask(points, how) for points in grid], compute, f"families, {family}")
    judged = [
        ModelTask(points, StackedVectors(how.model, one.entity, one.relation))
        for points, one in zip(grid, learned, strict=True)
    ]
    measured = run(measure, judged, compute, f"families, {family}, measured")
    table = pd.concat(rows(frame, one) for frame, one in zip(measured, learned, strict=True))
    MODEL_COMPARISON.write(table, given.stage, experiment=experiment, model=family)


if __name__ == "__main__":
    compare_families()
