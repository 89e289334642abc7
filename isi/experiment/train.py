"""Training of Θ⁰ and of the joint models over the grid,
and measures of embeddings as rows of tables.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.evaluation.changes import changed_query_sets
from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import MEASURES, Queries, Result, evaluate, measure_rows
from isi.models.model import Model
from isi.models.stack import Embedding, uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
from isi.training.trainer import Training
from stages.grid import GridPoints


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


def training_start(points: GridPoints, config: TrainConfig) -> tuple[Embedding, TrainingData]:
    """The initial embedding and the training data of D⁰."""
    session, keys = points.session(0), points.keys()
    shape = len(points.graph.relations), config.model, config.dimension, config.init_range
    start = uniform(session.entities, *shape, config.root, keys)
    return start, training_data(session, "training", keys)


def train_stack(points: GridPoints, config: TrainConfig) -> TrainResult:
    """Train on D⁰ until validation MRR* stops improving: Θ⁰, or, at points where all entities are
    known, the joint model (section 5.3).
    """
    start, data = training_start(points, config)
    best, looks = trainer.train_until_best(
        start, data, config.negatives, config.training, config.root
    )
    return TrainResult(best, data.session.entities.cpu().numpy(), run_rows(points, looks))


#: Number of joint models whose measures are averaged where all seeds share one split, as the
#: paper's authors do.
JOINT_MODELS = 5


def joint_points(grid: Sequence[GridPoints], shares_split: bool) -> list[GridPoints]:
    """Points at which the joint models are trained: those of every seed, for all sizes; or those
    of the first seeds, where all share one split.
    """
    every = [points.all_known for points in grid if points.size == grid[0].size]
    if not shares_split:
        return every
    first = every[0]
    seeds = [seed for points in every for seed in points.seeds][:JOINT_MODELS]
    splits = np.repeat(first.splits[:1], len(seeds), 0)
    novel = first.novel[:1].repeat(len(seeds), 0)
    return [replace(first, seeds=seeds, splits=splits, novel=novel)]


def as_tensors(trained: Iterable[tuple[GridPoints, TrainResult]]) -> dict[str, Tensor]:
    """Trained embeddings, each of grid points, as the tensors of a file."""
    parts = defaultdict[str, list[Tensor]](list)
    for points, result in trained:
        parts["entity"].append(result.theta.entity)
        parts["relation"].append(result.theta.relation)
        parts["known"].append(torch.from_numpy(result.known))
        parts["seed"].append(torch.tensor(points.seeds))
    return {name: torch.cat(tensors) for name, tensors in parts.items()}


def evaluate_stack(
    points: GridPoints, joint: Sequence[Embedding], with_changes: bool = False
) -> pd.DataFrame:
    """Measures of joint models on D¹ in all query sets (``RUNS``, epoch 0), the mean over models;
    ``with_changes``: in those of changes of the measure, too.
    """
    every = measured_sets(points, with_changes)
    frames = list[pd.DataFrame]()
    for theta in joint:
        results = dict[str, Result]()
        for sharing in every:
            results |= evaluate(theta, sharing)
        frames.append(run_rows(points, [measure_rows(results)]))
    measured, mean = frames[0], sum(frame[list(MEASURES)].to_numpy() for frame in frames)
    measured[list(MEASURES)] = mean / len(frames)
    return measured


def measured_sets(points: GridPoints, with_changes: bool) -> list[dict[str, Queries]]:
    """The query sets of D¹, and those of changes of the measure."""
    given = points.session(1), points.novel_ids, points.insert_mask
    changed = [changed_query_sets(*given)] if with_changes else []
    return [query_sets(*given), *changed]


def run_rows(points: GridPoints, looks: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Rows of measures with size and seed (``RUNS``)."""
    rows = pd.concat(looks, ignore_index=True)
    seeds = np.array(points.seeds)[rows["place"]]
    return rows.drop(columns="place").assign(size=points.size, seed=seeds)
