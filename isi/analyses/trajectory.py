"""Vectors on a plane: the one on which they vary most, and other vectors turned towards them.

One novel entity from where it is inserted to where fine-tuning takes it (Figure 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Count, Seed, Study
from isi.experiment.insert import InsertTask, finetune, initialize, with_vectors
from isi.initializers.similarity import has_insert_triples, has_words
from isi.models.stack import Embedding
from isi.tables.table import TensorFile
from isi.training.trainer import never_stop

#: ``entity``, ``known``, ``theta0``, and of each initializer ``NAME.path`` and ``NAME.indicators``.
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")


@dataclass(frozen=True)
class Plane:
    """The two axes on which vectors vary most."""

    #: shapes: (d,), (2, d)
    centre: Tensor
    axes: Tensor
    #: share of the vectors' variance on them
    share: float


def plane(vectors: Tensor) -> Plane:
    """The two principal axes of vectors, (N, d), whose largest coordinates are positive."""
    vectors = vectors.double()
    centre = vectors.mean(0)
    _, lengths, axes = torch.linalg.svd(vectors - centre, full_matrices=False)
    largest = axes[:2].gather(1, axes[:2].abs().argmax(1, keepdim=True))
    return Plane(centre, axes[:2] * largest.sign(), float(lengths[:2].square().sum() / lengths.square().sum()))


def on(axes: Plane, vectors: Tensor) -> Tensor:
    """Where vectors, (..., d), lie on a plane; shape (..., 2)."""
    return (vectors.double() - axes.centre) @ axes.axes.T


def turn(vectors: Tensor, onto: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Vectors moved, turned and scaled so that the known ones lie as near to others as they can (Procrustes).

    Args:
        vectors: shape (M, E, d).
        onto: the same.
        known: shape (M, E), bool.

    Returns:
        shape (M, E, d), and the share of the variance of the others that the known ones then have; (M,).
    """
    moved, shares = [], []
    for one, other, own in zip(vectors.double(), onto.double(), known, strict=True):
        centre, target = one[own].mean(0), other[own].mean(0)
        apart, wanted = one[own] - centre, other[own] - target
        left, lengths, right = torch.linalg.svd(apart.T @ wanted)
        scale = lengths.sum() / apart.square().sum()
        moved.append((one - centre) @ left @ right * scale + target)
        shares.append(lengths.sum() * scale / wanted.square().sum())
    return torch.stack(moved), torch.stack(shares)


#: The paper's initializers.
TRACED = ("xavier", "iu", "es", "rs", "ers")


class Trajectories(Study):
    """``trajectory`` in params: which set is followed, and for how long."""

    size: Count
    seed: Seed
    kind: str
    epochs: Count


@dataclass(frozen=True)
class TrajectoryTask(InsertTask):
    """Insert the novel entities of one grid point and follow one of them: a stack of height 1."""

    #: of the entity in ``novel``
    place: int = 0


@dataclass(frozen=True)
class Trajectory:
    """What becomes of one novel entity."""

    #: its vector before training and after each epoch; shape: (epochs + 1, d)
    path: np.ndarray
    #: its indicators, none where the initializer takes none; shape: (E,), bool
    indicators: np.ndarray


def trace_trajectory(task: TrajectoryTask) -> Trajectory:
    """Follow the entity through the fine-tuning of the first session."""
    theta0, novel = task.theta0.stack, task.points.novel_in(1)
    initial = initialize(task, theta0, 1)
    path = list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        entity = novel[0, task.place]
        path.append(embedding.entity[0, entity].clone() if epoch else initial.vectors[0, task.place])
        return never_stop(epoch, embedding, models)

    finetune(task, with_vectors(theta0, novel, initial.vectors), 1, watch)
    indicators = torch.zeros(len(task.points.graph.entities), dtype=torch.bool)
    if initial.indicators is not None:
        indicators = initial.indicators[0, task.place]
    return Trajectory(torch.stack(path).cpu().numpy(), indicators.cpu().numpy())


def place_of_interest(task: InsertTask, kinds: pd.Series, kind: str) -> int | None:
    """Place of the first novel entity of a kind that has a word vector and insert triples; None where there is none.

    Args:
        kinds: of entities, by id.
    """
    context = task.context(task.theta0.stack, 1)
    able = (has_words(context) & has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[task.points.novel[0, 0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None
