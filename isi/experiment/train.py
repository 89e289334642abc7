"""Training Θ⁰ and the joint models.

Measuring embeddings as they are, and measures as rows of tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.evaluation import query_sets
from isi.evaluation.ranking import MEASURES, Result, evaluate
from isi.experiment.grid import GridPoints, StackedVectors
from isi.graph.sessions import Session
from isi.models.model import Model, make_model
from isi.models.stack import uniform
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Training

if TYPE_CHECKING:
    from isi.params import Params


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
class TrainTask:
    """Train an embedding of each grid point."""

    points: GridPoints
    how: TrainConfig


@dataclass(frozen=True)
class TrainResult:
    """Trained embeddings of a task's points."""

    entity: np.ndarray
    relation: np.ndarray
    known: np.ndarray
    log: pd.DataFrame


def model_of(params: Params, name: str | None = None) -> Model:
    """The embedding model of a name, or that params choose, with its options."""
    name = name or params.embedding.model
    return make_model(name, params.models[name], f"models.{name}")


def train_config(params: Params, model: Model | None = None, training: Training | None = None) -> TrainConfig:
    """How params say that embeddings are trained, or with another model and training."""
    model, training = model or model_of(params), training or params.training
    trainer.compile_ahead(model, training.batch_size)
    embedding = params.embedding
    return TrainConfig(params.seed, model, embedding.dimension, embedding.init_range, params.negatives, training)


def train_initial(task: TrainTask) -> TrainResult:
    """Train Θ⁰ of each grid point on its D⁰."""
    return _learn(task, task.points.session(0))


def train_joint_model(task: TrainTask) -> TrainResult:
    """Train the joint model of each seed on all that has a split (section 5.3)."""
    return _learn(task, task.points.joint)


def _learn(task: TrainTask, session: Session) -> TrainResult:
    how, points, keys = task.how, task.points, task.points.keys()
    relations = len(points.graph.relations)
    start = uniform(session.entities, relations, how.model, how.dimension, how.init_range, how.root, keys)
    data = training_data(session, "training", keys, how.negatives.head_pool)
    best, looks = trainer.train_until_best(start, data, how.negatives, how.training, how.root)
    log = pd.concat(
        pd.DataFrame(dict(zip(MEASURES, look.measures.T.cpu().numpy(), strict=True))).assign(
            size=points.size,
            seed=np.array(points.seeds)[look.models.cpu().numpy()],
            epoch=look.epoch,
            kept=look.is_best.cpu().numpy(),
        )
        for look in looks
    )
    entity, relation, known = (table.cpu().numpy() for table in (best.entity, best.relation, session.entities))
    return TrainResult(entity, relation, known, log)


def as_tensors(tasks: Sequence[TrainTask], learned: Sequence[TrainResult]) -> dict[str, Tensor]:
    """Trained embeddings of several tasks of one size, as the tensors of one file."""
    tensors = {
        name: torch.from_numpy(np.concatenate([getattr(result, name) for result in learned]))
        for name in ("entity", "relation", "known")
    }
    return tensors | {"seed": torch.tensor([seed for task in tasks for seed in task.points.seeds])}


@dataclass(frozen=True)
class EvaluationTask:
    """Measure given embeddings in every scope of every session that inserts."""

    points: GridPoints
    theta: StackedVectors
    #: (session, model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 4)
    insert_triples: np.ndarray


def evaluate_stack(task: EvaluationTask) -> pd.DataFrame:
    """Measures of embeddings as they are, in every scope (``tables.RUNS``, epoch 0)."""
    points, theta, rows = task.points, task.theta.stack, []
    for number in range(1, points.sessions + 1):
        session, novel = points.session(number), points.novel_in(number)
        told = points.insert_triples_in(number, task.insert_triples)
        results = evaluate(theta, query_sets.epoch_query_sets(session, novel))
        results |= evaluate(theta, query_sets.novel_query_set(session, novel, told))
        rows.append(run_rows(points, number, 0, torch.arange(len(points.seeds)), results))
    return pd.concat(rows)


def run_rows(
    points: GridPoints, session: int, epoch: int, models: Tensor, results: Mapping[str, Result]
) -> pd.DataFrame:
    """Measures of models of some grid points after an epoch, by scope (``tables.RUNS`` and ``tables.TIES``)."""
    seeds = np.array(points.seeds)[models.cpu().numpy()]
    return pd.concat(
        measure_columns(result).assign(size=points.size, seed=seeds, epoch=epoch, scope=scope, session=session)
        for scope, result in results.items()
    )


def measure_columns(result: Result) -> pd.DataFrame:
    """A result as columns, one row a model."""
    columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
    return pd.DataFrame(columns | {"queries": result.queries.cpu().numpy(), "ties": result.ties.cpu().numpy()})
