"""Train Θ⁰ on D⁰, for every size and seed."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.models.model import EmbeddingParams
from isi.models.stack import Embedding
from isi.tables import io
from isi.training.batches import Negatives
from isi.training.fit import TrainConfig, fit
from isi.training.trainer import Training, compile_ahead
from stages.grid import GridPoints
from stages.params import StageParams
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import THETA0, TRAINING_LOG, Store, model_of


@dataclass(frozen=True)
class TrainResult:
    """Trained embeddings of grid points."""

    theta: Embedding
    known: np.ndarray  #: entities of the session; shape: (M, E), bool
    log: pd.DataFrame  #: in the columns of ``TRAINING_LOG``


@stage
def train_theta0(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    config, compute = train_config(params), params.read("compute", Compute)
    grid = store.grid(stack_height(compute))
    warn_of_batch(grid[0], config)
    tasks = [(points, config) for points in grid]
    trained = run(train_stack, tasks, compute, f"{experiment}, theta0")
    sizes = sorted({points.size for points in grid})
    for size in sizes:
        of_size = [
            (points, result)
            for points, result in zip(grid, trained, strict=True)
            if points.size == size
        ]
        THETA0.write(as_tensors(of_size), context.stage, experiment=experiment, size=size)
    written = [THETA0.path(experiment=experiment, size=size) for size in sizes]
    io.keep_only(written[0].parent, written)
    log = pd.concat(result.log for result in trained)
    TRAINING_LOG.write(log, context.stage, experiment=experiment, model="theta0")


def train_config(params: StageParams) -> TrainConfig:
    """How params train Θ⁰ and the joint models. Where an epoch's updates are compiled, they are
    compiled here, once, before processes start.
    """
    embedding: EmbeddingParams = params.read("embedding", EmbeddingParams)
    training: Training = params.read("training", Training)
    model = model_of(params, embedding.model)
    compile_ahead(model, training.batch_size)
    return TrainConfig(
        root=params.seed,
        model=model,
        dimension=embedding.dimension,
        init_range=embedding.init_range,
        negatives=params.read("negatives", Negatives),
        training=training,
    )


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


def train_stack(points: GridPoints, config: TrainConfig) -> TrainResult:
    """Train on D⁰ until validation MRR* stops improving: Θ⁰, or, at points where all entities are
    known, the joint model (section 5.3).
    """
    session = points.session(0)
    best, looks = fit(session, points.keys(), config)
    return TrainResult(best, session.entities.cpu().numpy(), points.run_rows(looks))


def as_tensors(trained: Iterable[tuple[GridPoints, TrainResult]]) -> dict[str, Tensor]:
    """Trained embeddings, each of grid points, as the tensors of a file."""
    parts = defaultdict[str, list[Tensor]](list)
    for points, result in trained:
        parts["entity"].append(result.theta.entity)
        parts["relation"].append(result.theta.relation)
        parts["known"].append(torch.from_numpy(result.known))
        parts["seed"].append(torch.tensor(points.seeds))
    return {name: torch.cat(tensors) for name, tensors in parts.items()}


if __name__ == "__main__":
    train_theta0()
