"""Training Θ⁰ and the joint models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi import lessons, ranking, training
from isi.embeddings.stack import uniform
from isi.experiments.cells import Cells
from isi.params import EmbeddingParams, Negatives, Training
from isi.ranking import MEASURES
from isi.sessions import Session


@dataclass(frozen=True)
class Learning:
    """How Θ⁰ and the joint model are trained."""

    root: int
    embedding: EmbeddingParams
    negatives: Negatives
    training: Training


@dataclass(frozen=True)
class LearningTask(Cells):
    learning: Learning


@dataclass(frozen=True)
class Learned:
    """Trained embeddings of a task's cells."""

    entity: np.ndarray
    relation: np.ndarray
    known: np.ndarray
    log: pd.DataFrame


def learn_initial(task: LearningTask) -> Learned:
    """Train Θ⁰ of each cell on its D⁰."""
    return _learn(task, task.initial)


def learn_joint(task: LearningTask) -> Learned:
    """Train the joint model of each seed on D¹ (section 5.3)."""
    return _learn(task, task.joint)


def _learn(task: LearningTask, session: Session) -> Learned:
    how, keys = task.learning, task.keys
    graph = task.graph
    start = uniform(
        session.entities, len(graph.relations), how.embedding.dimension, how.embedding.init_range, how.root, keys
    )
    lesson = lessons.lesson(session, "training", keys, how.negatives.head_pool)
    valid = ranking.validation(session)["valid"]
    best, looks = training.fit(start, lesson, valid, how.negatives, how.training, how.root)
    log = pd.concat(
        pd.DataFrame(dict(zip(MEASURES, look.measures.T.cpu().numpy(), strict=True))).assign(
            size=task.size,
            seed=np.array(task.seeds)[look.models.cpu().numpy()],
            epoch=look.epoch,
            kept=look.kept.cpu().numpy(),
        )
        for look in looks
    )
    entity, relation, known = (table.cpu().numpy() for table in (best.entity, best.relation, session.entities))
    return Learned(entity, relation, known, log)


def as_tensors(tasks: Sequence[Cells], learned: Sequence[Learned]) -> dict[str, Tensor]:
    """Trained embeddings of several tasks of one size, as the tensors of one file."""
    tensors = {
        name: torch.from_numpy(np.concatenate([getattr(result, name) for result in learned]))
        for name in ("entity", "relation", "known")
    }
    return tensors | {"seed": torch.tensor([seed for task in tasks for seed in task.seeds])}
