"""Trace the vector of one novel entity through fine-tuning, from each initializer."""

from dataclasses import replace

import torch

from isi.analyses import trajectory as analysis
from isi.analyses.trajectory import TRAJECTORY, place_of_traced, traced
from isi.errors import InputError
from isi.tables import paths
from stages.runner import run
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def trace_trajectory(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    settings = params.trajectory
    points = next(
        (points for points in store.grid(1, settings.size) if points.seeds == [settings.seed]), None
    )
    if points is None:
        expected = f"expected one of the seeds of {experiment}, got {settings.seed}"
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    theta0, words = store.theta0(points, params.model_of()), store.words()
    place = place_of_traced(points, theta0, words, store.entities()["kind"], settings.kind)
    if place is None:
        expected = (
            f"expected a seed with a novel {settings.kind} that has a "
            "word vector and insert triples"
        )
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    names, tasks = traced(params.initializers), []
    optimizer = params.finetuning.model_copy(update={"max_epochs": settings.epochs})
    for name in names:
        config = replace(params.insert_config(name), optimizer=optimizer)
        tasks.append((points, theta0, words, config, place))
    entity = torch.from_numpy(points.novel[0, place : place + 1])
    tensors = {"entity": entity, "known": points.session(0).entities[0], "theta0": theta0.entity[0]}
    traces = run(analysis.trace_trajectory, tasks, params.compute, "trajectory")
    for name, (path, indicators) in zip(names, traces, strict=True):
        tensors |= {
            f"{name}.path": torch.from_numpy(path),
            f"{name}.indicators": torch.from_numpy(indicators),
        }
    TRAJECTORY.write(tensors, context.stage, experiment=experiment)


if __name__ == "__main__":
    trace_trajectory()
