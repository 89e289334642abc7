"""Training Θ⁰ and the joint models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.params import check
from isi.base.stage import Given
from isi.embeddings.family import Family
from isi.embeddings.stack import uniform
from isi.experiments.cells import Cells
from isi.families import EmbeddingParams, make
from isi.learning import one_by_one, training
from isi.learning.batches import Negatives, training_data
from isi.learning.ranks import MEASURES
from isi.learning.training import Training
from isi.sessions.session import Session


@dataclass(frozen=True)
class Learning:
    """How Θ⁰ and the joint model are trained."""

    root: int
    family: Family
    dimension: int
    init_range: float
    negatives: Negatives
    training: Training


@dataclass(frozen=True)
class LearningTask:
    """Train an embedding of each cell."""

    cells: Cells
    how: Learning


@dataclass(frozen=True)
class Learned:
    """Trained embeddings of a task's cells."""

    entity: np.ndarray
    relation: np.ndarray
    known: np.ndarray
    log: pd.DataFrame


def family_of(given: Given, name: str | None = None) -> Family:
    """The embedding family of a name, or that a stage's params choose, with its options."""
    name = name or given.section("embedding.family", str)
    return make(name, given.raw(f"families.{name}"), f"families.{name}")


def learning(given: Given, family: str | None = None, **changed: float) -> Learning:
    """How a stage's params say that embeddings are trained, of the family that they choose or another one.

    Args:
        changed: values of ``training`` in place of those of params.
    """
    named = {"family": family} if family else {}
    embedding = check({**given.raw("embedding"), **named}, EmbeddingParams, "embedding")
    kind, how = family_of(given, embedding.family), check({**given.raw("training"), **changed}, Training, "training")
    one_by_one.prepare(kind, how.batch_size)
    negatives = given.section("negatives", Negatives)
    return Learning(given.seed, kind, embedding.dimension, embedding.init_range, negatives, how)


def learn_initial(task: LearningTask) -> Learned:
    """Train Θ⁰ of each cell on its D⁰."""
    return _learn(task, task.cells.session(0))


def learn_joint(task: LearningTask) -> Learned:
    """Train the joint model of each seed on all that has a split (section 5.3)."""
    return _learn(task, task.cells.joint)


def _learn(task: LearningTask, session: Session) -> Learned:
    how, cells, keys = task.how, task.cells, task.cells.keys()
    relations = len(cells.graph.relations)
    start = uniform(session.entities, relations, how.family, how.dimension, how.init_range, how.root, keys)
    data = training_data(session, "training", keys, how.negatives.head_pool)
    best, looks = training.fit(start, data, how.negatives, how.training, how.root)
    log = pd.concat(
        pd.DataFrame(dict(zip(MEASURES, look.measures.T.cpu().numpy(), strict=True))).assign(
            size=cells.size,
            seed=np.array(cells.seeds)[look.models.cpu().numpy()],
            epoch=look.epoch,
            kept=look.kept.cpu().numpy(),
        )
        for look in looks
    )
    entity, relation, known = (table.cpu().numpy() for table in (best.entity, best.relation, session.entities))
    return Learned(entity, relation, known, log)


def as_tensors(tasks: Sequence[LearningTask], learned: Sequence[Learned]) -> dict[str, Tensor]:
    """Trained embeddings of several tasks of one size, as the tensors of one file."""
    tensors = {
        name: torch.from_numpy(np.concatenate([getattr(result, name) for result in learned]))
        for name in ("entity", "relation", "known")
    }
    return tensors | {"seed": torch.tensor([seed for task in tasks for seed in task.cells.seeds])}
