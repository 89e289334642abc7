"""The final model of a whole graph."""

from statistics import median_low

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.experiment.train import TrainConfig, training_start
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN
from isi.models.stack import Embedding
from isi.training.trainer import train
from stages.grid import GridPoints


def usual_epochs(log: pd.DataFrame) -> int:
    """Lower median over seeds of the best epoch in ``log`` (``TRAINING_LOG``);
    ``InputError`` if no epoch is best.
    """
    kept = log[log["kept"]].groupby("seed")["epoch"].max()
    if kept.empty:
        raise InputError(
            "joint.log.parquet", "column 'kept'", "expected true in at least one row, a best epoch"
        )
    return int(median_low(kept.tolist()))


def whole_graph(experiment: str, graph: Graph) -> GridPoints:
    """A grid point with all triples in train and the random streams of
    the joint model of seed 0.
    """
    splits = np.full((1, len(graph.triples)), TRAIN, dtype=np.int8)
    return GridPoints.without_insertion(experiment, graph, [0], splits)


def train_final(points: GridPoints, config: TrainConfig, epochs: int) -> Embedding:
    """Train the final model on the training triples of ``points`` for a fixed number of epochs."""
    optimizer = config.training.model_copy(update={"max_epochs": epochs})
    return train(*training_start(points, config), config.negatives, optimizer, config.root)
