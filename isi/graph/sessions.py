"""Sessions of incremental learning: when each entity and each triple of a graph arrives, and in which split."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from isi.graph.graph import Graph

#: Split of a triple in a session; ``OUT`` where it takes no part.
OUT, TRAIN, VALID, TEST = -1, 0, 1, 2
SPLIT_NAMES = ("train", "valid", "test")
#: Arrival of what takes part in no session.
NEVER = 2**31 - 1


@dataclass(frozen=True)
class Session:
    """A stack of M learning sessions over one graph: which entities and triples take part."""

    #: which all of them share
    graph: Graph = field(metadata={"shared": True})
    #: shape: (M, E), bool
    entities: Tensor
    #: TRAIN, VALID, TEST or OUT; shape: (M, T), int8
    splits: Tensor

    def members(self, *splits: int) -> Tensor:
        """Whether a unique triple belongs to one of the splits; shape: (M, T), bool."""
        return torch.isin(self.splits, torch.tensor(splits, dtype=self.splits.dtype))

    def trained(self) -> Tensor:
        """Entities that take part and have a training triple; shape: (M, E), bool."""
        return self.entities & ends(self.graph, self.members(TRAIN))


@dataclass(frozen=True)
class Timeline:
    """Sessions D⁰, D¹, ... of a stack of M models over one graph: each has what has arrived by then (section 5.2)."""

    graph: Graph
    #: session in which an entity arrives, 0 if it is known from the start; shape: (M, E), int64
    entity_arrival: Tensor
    #: the same of unique triples, of which none arrives before its ends; shape: (M, T), int64
    triple_arrival: Tensor
    #: TRAIN, VALID, TEST or OUT; shape: (M, T), int8
    splits: Tensor

    @classmethod
    def of_novel(cls, graph: Graph, splits: Tensor, novel: Tensor) -> Timeline:
        """A triple arrives with the later of its ends, and an entity without a triple that has a split never.

        Args:
            splits: shape (M, T).
            novel: ids of the entities that each of S sessions inserts; shape (M, S, n).
        """
        arrival = torch.zeros(len(splits), len(graph.entities), dtype=torch.int64)
        for session in range(novel.shape[1]):
            arrival.scatter_(1, novel[:, session], session + 1)
        arrival.masked_fill_(~ends(graph, splits != OUT), NEVER)
        by_end = (arrival[:, graph.triples[:, slot]] for slot in (0, 2))
        return cls(graph, arrival, torch.maximum(*by_end), splits)

    def session(self, number: int) -> Session:
        """D after a number of sessions: 0 is what is known from the start."""
        splits = self.splits.masked_fill(self.triple_arrival > number, OUT)
        return Session(self.graph, self.entity_arrival <= number, splits)


def session_of(graph: Graph, splits: Tensor) -> Session:
    """The session of all triples that have a split, shape (M, T), and of their entities."""
    return Session(graph, ends(graph, splits != OUT), splits)


def touches(graph: Graph, entities: Tensor) -> Tensor:
    """Whether a unique triple has an end among the entities, shape (M, E); shape: (M, T), bool."""
    return entities[:, graph.triples[:, 0]] | entities[:, graph.triples[:, 2]]


def ends(graph: Graph, triples: Tensor) -> Tensor:
    """Whether an entity is an end of one of the triples, shape (M, T), bool; shape: (M, E), bool."""
    number = torch.zeros(len(triples), len(graph.entities))
    for slot in (0, 2):
        number.index_add_(1, graph.triples[:, slot], triples.float())
    return number > 0


def membership(ids: Tensor, entities: int) -> Tensor:
    """Ids, shape (M, n), as a mask of shape (M, E)."""
    return torch.zeros(len(ids), entities, dtype=torch.bool).scatter_(1, ids, True)
