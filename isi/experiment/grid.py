"""Points of the grid of insertions. A grid point is a (size, seed); a task is a stack of grid points of one size.

A task carries plain values and arrays and depends on nothing else, so that results are the same
however tasks are spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi.graph import sessions
from isi.graph.graph import Graph
from isi.graph.sampling import later_key
from isi.graph.sessions import Session
from isi.models.model import Model
from isi.models.stack import Embedding

#: Size that stands for no insertion, in keys of random streams and in logs.
NO_INSERTION = 0


@dataclass(frozen=True)
class GridPoints:
    """Grid points of one size, over one graph."""

    experiment: str
    graph: Graph
    size: int
    seeds: list[int]
    #: of each seed; shape: (M, T), int8
    splits: np.ndarray
    #: ids of the novel entities, by the session that inserts them; shape: (M, S, size)
    novel: np.ndarray

    def __str__(self) -> str:
        return f"{self.experiment}, size {self.size}, seeds {', '.join(map(str, self.seeds))}"

    @property
    def sessions(self) -> int:
        """How many sessions insert."""
        return int(self.novel.shape[1])

    def keys(self, number: int = 1) -> Tensor:
        """(size, seed) of each model, for its random streams in a session; shape: (M, 2), (M, 3) after the first."""
        return torch.tensor([[self.size, seed, *later_key(number)] for seed in self.seeds])

    def session(self, number: int) -> Session:
        """D of the session after which so many have inserted: D⁰, D¹, ..."""
        absent = self.novel[:, number:].reshape(len(self.seeds), -1)
        return sessions.without(self.graph, torch.as_tensor(self.splits), torch.as_tensor(absent))

    @property
    def joint(self) -> Session:
        """D of the last session: all that has a split."""
        return sessions.everything(self.graph, torch.as_tensor(self.splits))

    def novel_in(self, number: int) -> Tensor:
        """Ids of the entities that a session inserts, from 1; shape: (M, size)."""
        return torch.as_tensor(self.novel[:, number - 1])

    def insert_triples_in(self, number: int, insert_triples: np.ndarray) -> Tensor:
        """The insert triples of a session as a mask, (M, T).

        Args:
            insert_triples: (session, model, place in ``novel``, triple); shape (I, 4).
        """
        own = insert_triples[insert_triples[:, 0] == number]
        mask = torch.zeros(self.splits.shape, dtype=torch.bool)
        mask[own[:, 1], own[:, 3]] = True
        return mask


@dataclass(frozen=True)
class StackedVectors:
    """An embedding of each grid point of a stack, as it travels to a worker."""

    model: Model
    #: shapes: (M, E, d), (M, R, w)
    entity: np.ndarray
    relation: np.ndarray

    @property
    def stack(self) -> Embedding:
        return Embedding(torch.as_tensor(self.entity), torch.as_tensor(self.relation), self.model)
