"""Follow one novel entity through fine-tuning, from where each initializer puts it."""

import torch

from isi.analyses import trajectory as analysis
from isi.analyses.trajectory import TRACED, TRAJECTORY, TrajectoryTask, place_of_interest
from isi.errors import InputError
from isi.experiment.insert import insert_config, insertion_tasks
from isi.experiment.runner import run
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def trace_trajectory(context: StageContext, experiment: str) -> None:
    """Follow one novel entity through fine-tuning, from where each initializer puts it."""
    params, settings, store = context.params, context.params.trajectory, Store(experiment)
    points = next((points for points in store.grid(1, settings.size) if points.seeds == [settings.seed]), None)
    if points is None:
        expected = f"expected one of the seeds of {experiment}, got {settings.seed}"
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    inserted = []
    for name in TRACED:
        inserted += insertion_tasks(
            store, params, insert_config(params, name).training(max_epochs=settings.epochs), [points]
        )
    place = place_of_interest(inserted[0], store.entities()["kind"], settings.kind)
    if place is None:
        expected = f"expected a seed with a novel {settings.kind} that has a word vector and insert triples"
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    tasks = [TrajectoryTask(**vars(task), place=place) for task in inserted]
    traces = run(analysis.trace_trajectory, tasks, params.compute, "trajectory")
    tensors = {
        "entity": torch.from_numpy(points.novel[0, 0, place : place + 1]),
        "known": points.session(0).entities[0],
        "theta0": torch.from_numpy(inserted[0].theta0.entity[0]),
    }
    for name, trace in zip(TRACED, traces, strict=True):
        tensors[f"{name}.path"] = torch.from_numpy(trace.path)
        tensors[f"{name}.indicators"] = torch.from_numpy(trace.indicators)
    TRAJECTORY.write(tensors, context.stage, experiment=experiment)


if __name__ == "__main__":
    trace_trajectory()
