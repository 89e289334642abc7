"""Follow one novel entity through fine-tuning, from where each initializer puts it."""

from __future__ import annotations

from dataclasses import replace

import torch

from isi.analyses.trajectory import (
    TRACED,
    TRAJECTORY,
    TrajectorySettings,
    TrajectoryTask,
    place_of_interest,
    trace_trajectory,
)
from isi.errors import InputError
from isi.experiment.insert import inserting, insertion_tasks
from isi.experiment.runner import compute_of, run
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def trace_approach(given: StageContext, experiment: str) -> None:
    """Follow one novel entity through fine-tuning, from where each initializer puts it."""
    study = given.section("approach", TrajectorySettings)
    store = Store(experiment)
    points = next((points for points in store.grid(1, study.size) if points.seeds == [study.seed]), None)
    if points is None:
        raise InputError(paths.PARAMS, "approach.seed", f"expected one of the seeds of {experiment}, got {study.seed}")
    inserted = []
    for name in TRACED:
        how = inserting(given, name)
        followed = replace(how, optimizer=how.optimizer.model_copy(update={"max_epochs": study.epochs}))
        inserted += insertion_tasks(store, given, followed, [points])
    place = place_of_interest(inserted[0], store.entities()["kind"], study.kind)
    if place is None:
        expected = f"expected a seed with a novel {study.kind} that has a word vector and insert triples"
        raise InputError(paths.PARAMS, "approach.seed", expected)
    traces = run(
        trace_trajectory, [TrajectoryTask(points, task, place) for task in inserted], compute_of(given), "approach"
    )
    tensors = {
        "entity": torch.from_numpy(points.novel[0, 0, place : place + 1]),
        "known": points.session(0).entities[0],
        "theta0": torch.from_numpy(inserted[0].theta0.entity[0]),
    }
    for name, traced in zip(TRACED, traces, strict=True):
        tensors[f"{name}.path"] = torch.from_numpy(traced.path)
        tensors[f"{name}.indicators"] = torch.from_numpy(traced.indicators)
    TRAJECTORY.write(tensors, given.stage, experiment=experiment)


if __name__ == "__main__":
    trace_approach()
