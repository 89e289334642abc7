"""Training of Θ⁰ and of the joint models over the grid,
and measures of embeddings as rows of tables.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.evaluation import query_sets
from isi.evaluation.ranking import evaluate, measure_rows
from isi.experiment.grid import GridPoints
from isi.models.model import Model
from isi.models.stack import Embedding, uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
from isi.training.trainer import Training


@dataclass(frozen=True)
class TrainConfig:
    """How Θ⁰ and the joint model are trained."""

    root: int
    model: Model
    dimension: int
    init_range: float
    negatives: Negatives
    training: Training


@dataclass(frozen=True)
class TrainResult:
    """Trained embeddings of grid points."""

    theta: Embedding
    known: np.ndarray  #: entities of the session; shape: (M, E), bool
    log: pd.DataFrame  #: in the columns of ``TRAINING_LOG``


def warn_of_batch(points: GridPoints, config: TrainConfig) -> None:
    """Print a line if a batch would hold all observations of the graph,
    so that an epoch is a single update.
    """
    size, observed = config.training.batch_size, int(points.graph.counts.sum())
    if size >= observed:
        advice = (
            f"the {observed:,} observations of {points.experiment}: an epoch is one update; "
            "try a tenth of them"
        )
        print(f"warning: training.batch_size {size:,} is not below {advice}", file=sys.stderr)


def training_start(
    points: GridPoints, config: TrainConfig, number: int = 0
) -> tuple[Embedding, TrainingData]:
    """The initial embedding and the training data of a session."""
    session, keys = points.session(number), points.keys(*([number] if number else []))
    shape = len(points.graph.relations), config.model, config.dimension, config.init_range
    start = uniform(session.entities, *shape, config.root, keys)
    return start, training_data(session, "training", keys)


def train_stack(points: GridPoints, config: TrainConfig, session: int = 0) -> TrainResult:
    """Train on D of a session until validation MRR* stops improving:
    Θ⁰ on D⁰, a joint model later (section 5.3).
    """
    start, data = training_start(points, config, session)
    best, looks = trainer.train_until_best(
        start, data, config.negatives, config.training, config.root
    )
    return TrainResult(best, data.session.entities.cpu().numpy(), run_rows(points, session, looks))


def joint_tasks(
    grid: Sequence[GridPoints], config: TrainConfig
) -> list[tuple[GridPoints, TrainConfig, int]]:
    """Tasks that train the joint models of every session;
    all sizes share the last session's, one per seed.
    """
    last = [(points.all_known, config, 0) for points in grid if points.size == grid[0].size]
    return [
        *last,
        *((points, config, session) for points in grid for session in range(1, points.sessions)),
    ]


def as_tensors(trained: Iterable[tuple[GridPoints, int, TrainResult]]) -> dict[str, Tensor]:
    """Trained embeddings, each of a session of grid points,
    as the tensors of a file (``GridPoints.joint_prefix``).
    """
    parts = defaultdict[str, list[Tensor]](list)
    for points, session, result in trained:
        tensors = {"entity": result.theta.entity, "relation": result.theta.relation}
        tensors |= {"known": torch.from_numpy(result.known), "seed": torch.tensor(points.seeds)}
        for name, tensor in tensors.items():
            parts[f"{points.joint_prefix(session) if session else ''}{name}"].append(tensor)
    return {name: torch.cat(tensors) for name, tensors in parts.items()}


def evaluate_stack(points: GridPoints, joint: Sequence[Embedding]) -> pd.DataFrame:
    """Measures of the joint model of each session in all scopes of that
    session (``RUNS``, epoch 0).
    """
    rows = []
    for number, theta in enumerate(joint, 1):
        session, novel = points.session(number), points.novel_in(number)
        results = evaluate(theta, query_sets.epoch_query_sets(session, novel))
        results |= evaluate(
            theta, query_sets.novel_query_set(session, novel, points.insert_mask(number))
        )
        rows.append(run_rows(points, number, [measure_rows(results)]))
    return pd.concat(rows)


def run_rows(points: GridPoints, session: int, looks: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Rows of measures with size, seed and session (``RUNS``, ``TIES``)."""
    rows = pd.concat(looks)
    seeds = np.array(points.seeds)[rows["place"]]
    return rows.drop(columns="place").assign(size=points.size, seed=seeds, session=session)
