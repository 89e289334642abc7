"""An embedding of all of a graph, to insert into: no triple is held out, and nothing stops it but its epochs."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median_low

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Study
from isi.errors import InputError
from isi.experiment.grid import NO_INSERTION, GridPoints, StackedVectors
from isi.experiment.train import TrainConfig
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN
from isi.models.stack import Embedding, uniform
from isi.training.batches import training_data
from isi.training.trainer import train


class FinalModel(Study):
    """``final_model`` in params."""


@dataclass(frozen=True)
class FinalModelTask:
    """Train one embedding on all triples of a graph."""

    points: GridPoints
    how: TrainConfig
    epochs: int


def final_task(experiment: str, graph: Graph, how: TrainConfig, epochs: int) -> FinalModelTask:
    """The task of an experiment's graph; its random streams are those of the joint model of seed 0."""
    splits, nobody = np.full((1, len(graph.triples)), TRAIN, dtype=np.int8), np.empty((1, 0, 0), dtype=np.int64)
    return FinalModelTask(GridPoints(experiment, graph, NO_INSERTION, [0], splits, nobody), how, epochs)


def usual_epochs(log: pd.DataFrame) -> int:
    """The median of the epochs after which joint models were kept (the lower one of two), by validation MRR*.

    Args:
        log: ``tables.TRAINING_LOG``.

    Raises:
        InputError: where none was kept.
    """
    kept = log[log["kept"]].groupby("seed")["epoch"].max()
    if kept.empty:
        raise InputError("joint.log.parquet", "column 'kept'", "expected an epoch that was kept")
    return int(median_low(kept.tolist()))


def train_final(task: FinalModelTask) -> StackedVectors:
    """The embedding of all triples of a graph after its epochs."""
    how, session, keys = task.how, task.points.joint, task.points.keys()
    relations = len(task.points.graph.relations)
    start = uniform(session.entities, relations, how.model, how.dimension, how.init_range, how.root, keys)
    data = training_data(session, "training", keys, how.negatives.head_pool)
    settings = how.training.model_copy(update={"max_epochs": task.epochs})
    theta = train(start, data, how.negatives, settings, how.root, _onward)
    return StackedVectors(how.model, theta.entity.cpu().numpy(), theta.relation.cpu().numpy())


def _onward(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:  # noqa: ARG001
    """Nobody leaves before the last epoch."""
    return torch.ones(len(models), dtype=torch.bool)
