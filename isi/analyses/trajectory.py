"""The trajectory of one novel entity through fine-tuning (Figure 1)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Count, Seed, Study
from isi.experiment.insert import InsertConfig, finetune, init_context, initialize, with_vectors
from isi.initializers import similarity
from isi.initializers.api import INITIALIZERS, Role
from isi.models.stack import Embedding
from isi.tables.table import TensorFile
from isi.training.trainer import never_stop
from stages.grid import GridPoints

#: Shapes: entity (1,), known (E,), theta0 (E, d); of each initializer: NAME.path (epochs + 1, d),
#: NAME.indicators (E,).
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")
#: Roles of the initializers whose path Figure 1 shows.
TRACED: tuple[Role, ...] = ("paper", "isi", "own")


def traced(initializers: Iterable[str]) -> list[str]:
    """Those of some initializers whose path Figure 1 shows, in order."""
    return [name for name in initializers if INITIALIZERS.get(name).role in TRACED]


class NovelSet(Study):
    """``explorer`` in params, and part of ``trajectory``: |ξ| and seed of a novel set."""

    size: Count
    seed: Seed


class Trajectories(NovelSet):
    """``trajectory`` in params: the novel set, kind of the traced entity, epochs of fine-tuning."""

    kind: str
    epochs: Count


def trace_trajectory(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors of the novel entity at ``place`` at epochs 0, 1, ..., (epochs + 1, d),
    and its indicators, (E,) bool.
    """
    novel = points.novel_ids
    initial = initialize(points, theta, words, config)
    path = list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        path.append(
            embedding.entity[0, novel[0, place]].clone() if epoch else initial.vectors[0, place]
        )
        return never_stop(epoch, embedding, models)

    finetune(points, with_vectors(theta, novel, initial.vectors), config, watch)
    none = torch.zeros(len(points.graph.entities), dtype=torch.bool)
    indicators = none if initial.indicators is None else initial.indicators[0, place]
    return torch.stack(path).cpu().numpy(), indicators.cpu().numpy()


def place_of_traced(
    points: GridPoints, theta0: Embedding, words: np.ndarray, kinds: pd.Series, kind: str
) -> int | None:
    """Index in ``novel`` of the first entity of ``kind`` with a word vector
    and insert triples, or None.
    """
    context = init_context(points, theta0, words, 0)
    able = (similarity.has_words(context) & similarity.has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[points.novel[0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None
