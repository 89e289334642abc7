"""Learning sessions, that is, which entities and triples take part, and random splits
(sections 5.2, 5.3).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from isi.graph.graph import Graph
from isi.random import stream

#: Split of a triple in a session; ``OUT`` where it takes no part.
OUT, TRAIN, VALID, TEST = -1, 0, 1, 2


@dataclass(frozen=True)
class Session:
    """A stack of M learning sessions over one graph: which entities and triples take part."""

    graph: Graph = field(metadata={"shared": True})  #: shared by all M sessions
    entities: Tensor  #: shape: (M, E), bool
    splits: Tensor  #: TRAIN, VALID, TEST or OUT; shape: (M, T), int8

    def members(self, *splits: int) -> Tensor:
        """Mask of the unique triples whose split is among ``splits``; shape: (M, T), bool."""
        return torch.stack([self.splits == split for split in splits]).any(0)

    def trained(self) -> Tensor:
        """Mask of the session's entities with at least one training triple; shape: (M, E), bool."""
        return self.entities & ends(self.graph, self.members(TRAIN))


def session_at(graph: Graph, splits: Tensor, novel: Tensor, number: int) -> Session:
    """D⁰, the graph without the novel entities (``number`` 0), or D¹, with them (section 5.2).

    An entity without triples in ``splits``, (M, T), takes part in neither. ``novel``: ids, (M, n).
    """
    takes_part = ends(graph, splits != OUT)
    if number:
        return Session(graph, takes_part, splits)
    is_novel = membership(novel, len(graph.entities))
    without = splits.masked_fill(touches(graph, is_novel), OUT)
    return Session(graph, takes_part & ~is_novel, without)


def session_of(graph: Graph, splits: Tensor) -> Session:
    """The session of all triples with a split, and of their ends;
    ``splits``: shape (M, T), ``OUT`` for no split.
    """
    return Session(graph, ends(graph, splits != OUT), splits)


def touches(graph: Graph, entities: Tensor) -> Tensor:
    """Mask, (M, T), of the unique triples with an end in ``entities``, a mask of shape (M, E)."""
    return entities[:, graph.triples[:, 0]] | entities[:, graph.triples[:, 2]]


def ends(graph: Graph, triples: Tensor) -> Tensor:
    """Mask, (M, E), of the heads and tails of ``triples``, a mask of shape (M, T)."""
    entities = len(graph.entities)
    # the last column is of no entity
    reached = torch.zeros(len(triples), entities + 1, dtype=torch.bool)
    for slot in (0, 2):
        reached.scatter_(1, torch.where(triples, graph.triples[:, slot], entities), True)
    return reached[:, :-1]


def membership(ids: Tensor, entities: int) -> Tensor:
    """Ids, shape (M, n), as a mask of shape (M, E)."""
    return torch.zeros(len(ids), entities, dtype=torch.bool).scatter_(1, ids, True)


def split(graph: Graph, root: int, seed: int, valid: float, test: float) -> np.ndarray:
    """Split unique triples at random into train, valid and test;
    every entity and relation is in train; (T,), int8.
    """
    free = _free(graph, stream(root, "splits", seed))
    tests, valids = round(test * len(graph.triples)), round(valid * len(graph.triples))
    splits = np.full(len(graph.triples), TRAIN, dtype=np.int8)
    splits[free[:tests]] = TEST
    splits[free[tests : tests + valids]] = VALID
    return splits


def folds(graph: Graph, root: int, number: int) -> np.ndarray:
    """Folds, (number, T), int8: in row i, fold i is in valid, all else in train,
    which has each entity and relation.
    """
    splits = np.full((number, len(graph.triples)), TRAIN, dtype=np.int8)
    for row, fold in zip(
        splits, np.array_split(_free(graph, stream(root, "folds")), number), strict=True
    ):
        row[fold] = VALID
    return splits


def _free(graph: Graph, rng: np.random.Generator) -> np.ndarray:
    """Ids of triples that may leave train, in random order:
    all but the first triple of each entity and relation.
    """
    triples = graph.triples.numpy()
    order = rng.permutation(len(triples))
    ends = triples[order][:, [0, 2]].ravel()
    first_of_entity = np.unique(ends, return_index=True)[1] // 2
    first_of_relation = np.unique(triples[order, 1], return_index=True)[1]
    return np.delete(order, np.union1d(first_of_entity, first_of_relation))
