"""One novel entity from where it is inserted to where fine-tuning takes it (Figure 1), and planes that show vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Count, Seed, Study
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.insert import InsertConfig, finetune, init_context, initialize, with_vectors
from isi.initializers.similarity import has_insert_triples, has_words
from isi.models.stack import Embedding
from isi.tables.table import TensorFile
from isi.training.trainer import never_stop

#: ``entity``, ``known``, ``theta0``, and of each initializer ``NAME.path`` and ``NAME.indicators``.
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")
#: The paper's initializers.
TRACED = ("xavier", "iu", "es", "rs", "ers")


class Trajectories(Study):
    """``trajectory`` in params: which set is followed, and for how long."""

    size: Count
    seed: Seed
    kind: str
    epochs: Count


def trace_trajectory(
    points: GridPoints, theta0: StackedVectors, words: np.ndarray, config: InsertConfig, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """Follow a novel entity of the first session, at its place in ``novel``, through fine-tuning; a stack of height 1.

    Returns:
        its vector before training and after each epoch, shape (epochs + 1, d); its indicators, none where the
        initializer takes none, shape (E,), bool.
    """
    theta, novel = theta0.stack, points.novel_in(1)
    initial = initialize(points, theta, words, config)
    path = list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        path.append(embedding.entity[0, novel[0, place]].clone() if epoch else initial.vectors[0, place])
        return never_stop(epoch, embedding, models)

    finetune(points, with_vectors(theta, novel, initial.vectors), config, watch)
    none = torch.zeros(len(points.graph.entities), dtype=torch.bool)
    indicators = none if initial.indicators is None else initial.indicators[0, place]
    return torch.stack(path).cpu().numpy(), indicators.cpu().numpy()


def place_of_interest(
    points: GridPoints, theta0: StackedVectors, words: np.ndarray, kinds: pd.Series, kind: str
) -> int | None:
    """Place of the first novel entity of a kind that has a word vector and insert triples; None where there is none.

    Args:
        kinds: of entities, by id.
    """
    context = init_context(points, theta0.stack, words, 0)
    able = (has_words(context) & has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[points.novel[0, 0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None


@dataclass(frozen=True)
class Plane:
    """The two axes on which vectors vary most."""

    #: shapes: (d,), (2, d)
    centre: Tensor
    axes: Tensor
    #: share of the vectors' variance on them
    share: float

    @classmethod
    def of(cls, vectors: Tensor) -> Plane:
        """The two principal axes of vectors, (N, d), whose largest coordinates are positive."""
        vectors = vectors.double()
        centre = vectors.mean(0)
        _, lengths, axes = torch.linalg.svd(vectors - centre, full_matrices=False)
        largest = axes[:2].gather(1, axes[:2].abs().argmax(1, keepdim=True))
        return cls(centre, axes[:2] * largest.sign(), float(lengths[:2].square().sum() / lengths.square().sum()))

    def project(self, vectors: Tensor) -> Tensor:
        """Where vectors, (..., d), lie on the plane; shape (..., 2)."""
        return (vectors.double() - self.centre) @ self.axes.T


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
    for model, target, mask in zip(vectors.double(), onto.double(), known, strict=True):
        centre, target_centre = model[mask].mean(0), target[mask].mean(0)
        offsets, target_offsets = model[mask] - centre, target[mask] - target_centre
        left, lengths, right = torch.linalg.svd(offsets.T @ target_offsets)
        scale = lengths.sum() / offsets.square().sum()
        moved.append((model - centre) @ left @ right * scale + target_centre)
        shares.append(lengths.sum() * scale / target_offsets.square().sum())
    return torch.stack(moved), torch.stack(shares)
