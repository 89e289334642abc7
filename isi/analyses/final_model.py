"""An embedding of all of a graph, to insert into: no triple is held out, and nothing stops it but its epochs."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median_low

import numpy as np
import pandas as pd

from isi.config import Study
from isi.errors import InputError
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.train import TrainConfig, TrainTask
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN
from isi.training.trainer import never_stop, train


class FinalModel(Study):
    """``final_model`` in params."""


@dataclass(frozen=True)
class FinalModelTask(TrainTask):
    """Train one embedding on all triples of a graph, for a number of epochs."""

    epochs: int = 0


def final_task(experiment: str, graph: Graph, config: TrainConfig, epochs: int) -> FinalModelTask:
    """The task of an experiment's graph; its random streams are those of the joint model of seed 0."""
    splits = np.full((1, len(graph.triples)), TRAIN, dtype=np.int8)
    return FinalModelTask(GridPoints.without_insertion(experiment, graph, [0], splits), config, epochs=epochs)


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
    config, (start, data) = task.config, task.start()
    optimizer = config.training.model_copy(update={"max_epochs": task.epochs})
    theta = train(start, data, config.negatives, optimizer, config.root, never_stop)
    return StackedVectors(config.model, theta.entity.cpu().numpy(), theta.relation.cpu().numpy())
