"""Embeddings of a learning session, trained from a random start (section 5.3)."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd
from torch import Tensor

from isi.graph.sessions import Session
from isi.models.model import Model
from isi.models.stack import Embedding, uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
from isi.training.trainer import Training


@dataclass(frozen=True)
class TrainConfig:
    """How embeddings are trained from a random start."""

    root: int
    model: Model
    dimension: int
    init_range: float
    negatives: Negatives
    training: Training


def fit(
    session: Session, keys: Tensor, config: TrainConfig
) -> tuple[Embedding, list[pd.DataFrame]]:
    """Train until validation MRR* stops improving: the best embedding of each model of a stack,
    and the measures of all epochs that were measured.

    ``keys``: of each model's random streams, (M, K).
    """
    start, data = training_start(session, keys, config)
    return trainer.train_until_best(start, data, config.negatives, config.training, config.root)


def fit_for(session: Session, keys: Tensor, config: TrainConfig, epochs: int) -> Embedding:
    """Train for a fixed number of epochs; arguments as in ``fit``."""
    optimizer = config.training.model_copy(update={"max_epochs": epochs})
    start, data = training_start(session, keys, config)
    return trainer.train(start, data, config.negatives, optimizer, config.root)


def training_start(
    session: Session, keys: Tensor, config: TrainConfig
) -> tuple[Embedding, TrainingData]:
    """The initial embedding and the training data of a session."""
    shape = len(session.graph.relations), config.model, config.dimension, config.init_range
    start = uniform(session.entities, *shape, config.root, keys)
    return start, training_data(session, "training", keys)
