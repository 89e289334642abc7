"""The grid of insertions: a grid point is a size and a seed;
a task has a stack of grid points of one size.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from isi.graph.graph import Graph
from isi.graph.sessions import Session, session_at

NO_INSERTION = 0  #: Size of grid points without insertion, in keys of random streams and in logs.
JOINT_MODEL = "joint"  #: Name of the joint model in tables and paths, in place of an initializer's.


@dataclass(frozen=True)
class GridPoints:
    """Grid points of one size, over one graph."""

    experiment: str
    graph: Graph
    size: int
    seeds: list[int]
    splits: np.ndarray  #: of each seed; shape: (M, T), int8
    #: ids of the novel entities, by the session that inserts them; shape: (M, S, size)
    novel: np.ndarray
    #: rows (session, model, place in ``novel``, triple id), ascending; shape: (I, 4)
    insert_triples: np.ndarray = field(default_factory=lambda: np.empty((0, 4), np.int64))

    @classmethod
    def without_insertion(
        cls, experiment: str, graph: Graph, seeds: list[int], splits: np.ndarray
    ) -> GridPoints:
        """Grid points at which every entity is known from the start."""
        return cls(
            experiment,
            graph,
            NO_INSERTION,
            seeds,
            splits,
            np.empty((len(seeds), 0, 0), dtype=np.int64),
        )

    def __str__(self) -> str:
        return f"{self.experiment}, size {self.size}, seeds {', '.join(map(str, self.seeds))}"

    @property
    def sessions(self) -> int:
        """Number S of sessions that insert."""
        return int(self.novel.shape[1])

    @property
    def all_known(self) -> GridPoints:
        """The same seeds with nothing to insert: D⁰ equals D of the last session."""
        return self.without_insertion(self.experiment, self.graph, self.seeds, self.splits)

    def keys(self, *more: int) -> Tensor:
        """Size, seed and more numbers of each model, as keys of its random streams;
        shape: (M, 2 + more).
        """
        return torch.tensor([[self.size, seed, *more] for seed in self.seeds])

    def session(self, number: int) -> Session:
        """D of a session: D⁰, D¹, ..."""
        return session_at(
            self.graph, torch.as_tensor(self.splits), torch.as_tensor(self.novel), number
        )

    @property
    def last_session(self) -> Session:
        """D of the last session: all triples with a split."""
        return self.session(self.sessions)

    def joint_prefix(self, session: int) -> str:
        """Prefix of the tensors of a session's joint models;
        all sizes share the models of the last session.
        """
        return "" if session == self.sessions else f"size={self.size:02d}.session={session}."

    def novel_in(self, session: int) -> Tensor:
        """Ids of the entities that a session (from 1) inserts; shape: (M, size)."""
        return torch.as_tensor(self.novel[:, session - 1])

    def insert_triples_in(self, session: int) -> np.ndarray:
        """(model, place in ``novel``, triple) of the insert triples of a session; shape: (I, 3)."""
        return self.insert_triples[self.insert_triples[:, 0] == session, 1:]

    def insert_mask(self, session: int) -> Tensor:
        """The insert triples of a session as a mask; shape: (M, T)."""
        mask = torch.zeros(self.splits.shape, dtype=torch.bool)
        rows = self.insert_triples_in(session)
        mask[rows[:, 0], rows[:, 2]] = True
        return mask
