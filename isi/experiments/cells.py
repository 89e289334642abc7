"""Cells of the grid. A cell is a (size, seed); a task is a stack of cells of one size.

A task carries plain values and arrays and depends on nothing else, so that results are the same
however tasks are spread.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from isi.embeddings.stack import Embedding
from isi.graph import Graph
from isi.sessions import Session, initial_session, joint_session

#: Size that stands for no insertion, in keys of random streams and in logs.
JOINT = 0


@dataclass(frozen=True)
class Cells:
    """Cells of one size, over one graph."""

    graph: Graph
    size: int
    seeds: list[int]
    #: of each seed; shape: (M, T), int8
    splits: np.ndarray
    #: ids of the novel entities; shape: (M, size)
    novel: np.ndarray
    #: that they belong to
    experiment: str = field(default="ai2thor", kw_only=True)

    def __str__(self) -> str:
        return f"{self.experiment}, size {self.size}, seeds {', '.join(map(str, self.seeds))}"

    @property
    def keys(self) -> Tensor:
        """(size, seed) of each model, for its random streams; shape: (M, 2)."""
        return torch.tensor([[self.size, seed] for seed in self.seeds])

    @property
    def joint(self) -> Session:
        """D¹ of each cell."""
        return joint_session(self.graph, torch.as_tensor(self.splits))

    @property
    def initial(self) -> Session:
        """D⁰ of each cell."""
        return initial_session(self.graph, torch.as_tensor(self.splits), torch.as_tensor(self.novel))


@dataclass(frozen=True)
class Embedded(Cells):
    """Cells with an embedding of each."""

    #: (entity, relation); shapes: (M, E, d), (M, R, d)
    embedding: tuple[np.ndarray, np.ndarray]

    @property
    def theta(self) -> Embedding:
        """The embedding as a stack."""
        return Embedding(*map(torch.as_tensor, self.embedding))
