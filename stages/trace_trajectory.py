"""Trace the vector of one novel entity through fine-tuning, from each initializer (Figure 1)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Count
from isi.errors import InputError
from isi.initializers import similarity
from isi.initializers.api import INITIALIZERS, Role
from isi.models.stack import Embedding
from isi.tables import paths
from isi.tables.table import TensorFile
from isi.training.trainer import never_stop
from stages.grid import GridPoints, NovelSet
from stages.insert import (
    InsertConfig,
    finetune,
    init_context,
    initialize,
    insert_config,
    with_vectors,
)
from stages.runner import Compute, run
from stages.stage import StageContext, stage
from stages.store import Store, model_of

#: Shapes: entity (1,), known (E,), theta0 (E, d); of each initializer: NAME.path (epochs + 1, d),
#: NAME.indicators (E,).
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")
#: Roles of the initializers whose path Figure 1 shows.
TRACED: tuple[Role, ...] = ("paper", "isi", "own")


def traced(initializers: Iterable[str]) -> list[str]:
    """Those of some initializers whose path Figure 1 shows, in order."""
    return [name for name in initializers if INITIALIZERS.get(name).role in TRACED]


class Trajectories(NovelSet):
    """``trajectory`` in params: the novel set, kind of the traced entity, epochs of fine-tuning."""

    kind: str
    epochs: Count


@stage
def trace_trajectory(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    settings: Trajectories = params.read("trajectory", Trajectories)
    points = next(
        (points for points in store.grid(1, settings.size) if points.seeds == [settings.seed]), None
    )
    if points is None:
        expected = f"expected one of the seeds of {experiment}, got {settings.seed}"
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    theta0, words = store.theta0(points, model_of(params)), store.words()
    place = place_of_traced(points, theta0, words, store.entities()["kind"], settings.kind)
    if place is None:
        expected = (
            f"expected a seed with a novel {settings.kind} that has a "
            "word vector and insert triples"
        )
        raise InputError(paths.PARAMS, "trajectory.seed", expected)
    initializers = params.read("initializers", dict[str, dict[str, Any]])
    names, tasks = traced(initializers), []
    for name in names:
        config = insert_config(params, name, initializers[name])
        optimizer = config.optimizer.model_copy(update={"max_epochs": settings.epochs})
        tasks.append((points, theta0, words, replace(config, optimizer=optimizer), place))
    traces = run(trace, tasks, params.read("compute", Compute), "trajectory")
    entity = torch.from_numpy(points.novel[0, place : place + 1])
    tensors = {"entity": entity, "known": points.session(0).entities[0], "theta0": theta0.entity[0]}
    for name, (path, indicators) in zip(names, traces, strict=True):
        tensors |= {
            f"{name}.path": torch.from_numpy(path),
            f"{name}.indicators": torch.from_numpy(indicators),
        }
    TRAJECTORY.write(tensors, context.stage, experiment=experiment)


def trace(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors of the novel entity at ``place`` at epochs 0, 1, ..., (epochs + 1, d),
    and its indicators, (E,) bool.
    """
    novel = points.novel_ids
    initial = initialize(points, theta, words, config)
    path = list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        path.append(
            embedding.entity[0, novel[0, place]].clone() if epoch else initial.vectors[0, place]
        )
        return never_stop(epoch, embedding, models)

    finetune(points, with_vectors(theta, novel, initial.vectors), config, watch)
    none = torch.zeros(len(points.graph.entities), dtype=torch.bool)
    indicators = none if initial.indicators is None else initial.indicators[0, place]
    return torch.stack(path).cpu().numpy(), indicators.cpu().numpy()


def place_of_traced(
    points: GridPoints, theta0: Embedding, words: np.ndarray, kinds: pd.Series, kind: str
) -> int | None:
    """Index in ``novel`` of the first entity of ``kind`` with a word vector
    and insert triples, or None.
    """
    context = init_context(points, theta0, words, 0)
    able = (similarity.has_words(context) & similarity.has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[points.novel[0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None


if __name__ == "__main__":
    trace_trajectory()
