"""Training of Θ⁰ and of the joint models over the grid, and measures of embeddings as rows of tables."""

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
from isi.models.model import Model, make_model
from isi.models.stack import Embedding, uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
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
    """Train an embedding of each grid point on D of a session: Θ⁰ on D⁰, a joint model on a later one."""

    points: GridPoints
    config: TrainConfig
    session: int = 0

    def start(self) -> tuple[Embedding, TrainingData]:
        """What training starts from, and what it learns from."""
        config, session = self.config, self.points.session(self.session)
        keys = self.points.keys(*([self.session] if self.session else []))
        relations = len(self.points.graph.relations)
        start = uniform(
            session.entities, relations, config.model, config.dimension, config.init_range, config.root, keys
        )
        return start, training_data(session, "training", keys, config.negatives.head_pool)


@dataclass(frozen=True)
class TrainResult:
    """Trained embeddings of a task's grid points."""

    #: shapes: (M, E, d), (M, R, w)
    entity: np.ndarray
    relation: np.ndarray
    #: entities of the session; shape: (M, E), bool
    known: np.ndarray
    #: in the columns of ``tables.TRAINING_LOG``
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


def train_stack(task: TrainTask) -> TrainResult:
    """Train the embeddings of a task until validation MRR* stops improving (section 5.3)."""
    config, points = task.config, task.points
    start, data = task.start()
    best, looks = trainer.train_until_best(start, data, config.negatives, config.training, config.root)
    log = pd.concat(
        pd.DataFrame(dict(zip(MEASURES, look.measures.T.cpu().numpy(), strict=True))).assign(
            size=points.size,
            seed=np.array(points.seeds)[look.models.cpu().numpy()],
            epoch=look.epoch,
            kept=look.is_best.cpu().numpy(),
        )
        for look in looks
    )
    entity, relation, known = (table.cpu().numpy() for table in (best.entity, best.relation, data.session.entities))
    return TrainResult(entity, relation, known, log)


def as_tensors(tasks: Sequence[TrainTask], results: Sequence[TrainResult]) -> dict[str, Tensor]:
    """Trained embeddings of several tasks of one size, as the tensors of one file."""
    tensors = {
        name: torch.from_numpy(np.concatenate([getattr(result, name) for result in results]))
        for name in ("entity", "relation", "known")
    }
    return tensors | {"seed": torch.tensor([seed for task in tasks for seed in task.points.seeds])}


def joint_tasks(grid: Sequence[GridPoints], config: TrainConfig) -> list[TrainTask]:
    """Training of the joint models of every session that inserts.

    Of the last session, whose D is that of every size, there is one model for each seed.
    """
    last = [TrainTask(points.all_known, config) for points in grid if points.size == grid[0].size]
    earlier = (TrainTask(points, config, session) for points in grid for session in range(1, points.sessions))
    return [*last, *earlier]


def joint_tensors(tasks: Sequence[TrainTask], results: Sequence[TrainResult]) -> dict[str, Tensor]:
    """Joint models as the tensors of one file, with a prefix for each session (``GridPoints.joint_prefix``)."""
    groups: dict[str, list[tuple[TrainTask, TrainResult]]] = {}
    for task, result in zip(tasks, results, strict=True):
        groups.setdefault(task.points.joint_prefix(task.session), []).append((task, result))
    return {
        f"{prefix}{name}": tensor
        for prefix, group in groups.items()
        for name, tensor in as_tensors(*zip(*group, strict=True)).items()
    }


def joint_vectors(tensors: Mapping[str, Tensor], model: Model, points: GridPoints) -> list[StackedVectors]:
    """The joint models of grid points, by session, of the tensors of one file."""
    row = {seed: number for number, seed in enumerate(tensors["seed"].tolist())}
    rows = [row[seed] for seed in points.seeds]
    prefixes = map(points.joint_prefix, range(1, points.sessions + 1))
    return [
        StackedVectors(model, *(tensors[f"{prefix}{name}"][rows].numpy() for name in ("entity", "relation")))
        for prefix in prefixes
    ]


@dataclass(frozen=True)
class EvaluationTask:
    """Measure the joint model of each session in every scope of that session."""

    points: GridPoints
    #: by session that inserts
    joint: Sequence[StackedVectors]
    #: (session, model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 4)
    insert_triples: np.ndarray


def evaluate_stack(task: EvaluationTask) -> pd.DataFrame:
    """Measures of embeddings as they are, in every scope (``tables.RUNS``, epoch 0)."""
    points, rows = task.points, []
    for number, joint in enumerate(task.joint, 1):
        session, novel = points.session(number), points.novel_in(number)
        insert_triples = points.insert_triples_in(number, task.insert_triples)
        results = evaluate(joint.stack, query_sets.epoch_query_sets(session, novel))
        results |= evaluate(joint.stack, query_sets.novel_query_set(session, novel, insert_triples))
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
