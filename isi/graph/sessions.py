"""A stack of learning sessions: which entities and triples of a graph take part (section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from isi.graph.graph import Graph

#: What a triple is to a session; ``OUT`` where it takes no part.
OUT, TRAIN, VALID, TEST = -1, 0, 1, 2
SPLITS = ("train", "valid", "test")


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


def everything(graph: Graph, splits: Tensor) -> Session:
    """The triples that have a split, shape (M, T), and their entities: D¹ where one session inserts."""
    return Session(graph, ends(graph, splits != OUT), splits)


def without(graph: Graph, splits: Tensor, absent: Tensor) -> Session:
    """The same without some entities, ids of shape (M, n), and without their triples: D⁰ without all novel ones."""
    is_absent = membership(absent, len(graph.entities))
    entities = everything(graph, splits).entities & ~is_absent
    return Session(graph, entities, splits.masked_fill(touches(graph, is_absent), OUT))


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
