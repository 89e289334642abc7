"""Learning sessions: splits, novel (OOKB) entities, insert triples, and what they make of a graph."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi import paths
from isi.errors import InputError
from isi.graph import Graph
from isi.streams import stream

#: What a triple is to a session; ``OUT`` where it takes no part.
OUT, TRAIN, VALID, TEST = -1, 0, 1, 2
SPLITS = ("train", "valid", "test")


@dataclass(frozen=True)
class Session:
    """A stack of M learning sessions over one graph: which entities and triples take part."""

    graph: Graph
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


def as_table(graph: Graph, triples: Tensor) -> Tensor:
    """Spread values of unique triples, shape (M, T), over all triples: shape (M, R, E, E)."""
    head, relation, tail = graph.triples.T
    table = triples.new_zeros(len(triples), len(graph.relations), len(graph.entities), len(graph.entities))
    table[:, relation, head, tail] = triples
    return table


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


def joint_session(graph: Graph, splits: Tensor) -> Session:
    """D¹: the triples that have a split, and their entities (section 5.2)."""
    return Session(graph, ends(graph, splits != OUT), splits)


def initial_session(graph: Graph, splits: Tensor, novel: Tensor) -> Session:
    """D⁰: without the novel entities, shape (M, n), and without their triples (section 5.2)."""
    is_novel = membership(novel, len(graph.entities))
    entities = joint_session(graph, splits).entities & ~is_novel
    return Session(graph, entities, splits.masked_fill(touches(graph, is_novel), OUT))


def split(graph: Graph, root: int, seed: int, valid: float, test: float) -> np.ndarray:
    """Split unique triples at random into train, valid and test; shape (T,), int8.

    Every entity and relation appears in train.
    """
    free = _free(graph, stream(root, "splits", seed))
    tests, valids = round(test * len(graph.triples)), round(valid * len(graph.triples))
    splits = np.full(len(graph.triples), TRAIN, dtype=np.int8)
    splits[free[:tests]] = TEST
    splits[free[tests : tests + valids]] = VALID
    return splits


def check_held_out(splits: Iterable[np.ndarray], valid: float, test: float) -> None:
    """See that each of some splits, shapes (T,), holds out the shares that it was to hold out.

    Raises:
        InputError: where one does not, because triples had to stay in train.
    """
    for codes in splits:
        for code, share in ((VALID, valid), (TEST, test)):
            if (codes == code).sum() < max(1, round(share * len(codes))):
                expected = "expected shares that leave triples to each split (for every entity, one stays in train)"
                raise InputError(paths.PARAMS, "sessions.valid, sessions.test", expected)


def folds(graph: Graph, root: int, number: int) -> np.ndarray:
    """Splits for cross-validation: in each, one fold is valid and the rest is train; shape (number, T), int8.

    Every entity and relation appears in the train of every fold; the triples that see to it are in no fold.
    """
    splits = np.full((number, len(graph.triples)), TRAIN, dtype=np.int8)
    for own, fold in zip(splits, np.array_split(_free(graph, stream(root, "folds")), number), strict=True):
        own[fold] = VALID
    return splits


def _free(graph: Graph, rng: np.random.Generator) -> np.ndarray:
    """The triples that may leave train, in random order: not the first that holds an entity or relation."""
    triples = graph.triples.numpy()
    order = rng.permutation(len(triples))
    ends = triples[order][:, [0, 2]].ravel()
    first_of_entity = np.unique(ends, return_index=True)[1] // 2
    first_of_relation = np.unique(triples[order, 1], return_index=True)[1]
    return np.delete(order, np.union1d(first_of_entity, first_of_relation))


def draw_novel(entities: int, root: int, size: int, seed: int) -> np.ndarray:
    """Draw the novel entities of a (size, seed) uniformly, in ascending order; shape (size,)."""
    return np.sort(stream(root, "novel", size, seed).choice(entities, size, replace=False))


def without(graph: Graph, entities: np.ndarray) -> np.ndarray:
    """Ids of the unique triples that have none of the entities as an end; shape (T',)."""
    return np.flatnonzero(~np.isin(graph.triples[:, [0, 2]].numpy(), entities).any(1))


def draw_insert_triples(
    graph: Graph, splits: np.ndarray, novel: np.ndarray, root: int, seed: int, fraction: float
) -> list[tuple[int, int]]:
    """The (entity, triple) pairs that a robot observes when it meets the novel entities.

    Of an entity's n unique training triples whose other end is known, max(1, ⌊fraction · n⌋).
    """
    triples = graph.triples.numpy()
    heads, tails = (np.isin(triples[:, slot], novel) for slot in (0, 2))
    usable = (splits == TRAIN) & (heads ^ tails)
    rng = stream(root, "insert triples", len(novel), seed)
    pairs: list[tuple[int, int]] = []
    for entity in novel:
        own = np.flatnonzero(usable & ((triples[:, 0] == entity) | (triples[:, 2] == entity)))
        count = max(1, math.floor(fraction * len(own))) if len(own) else 0
        pairs.extend((int(entity), int(triple)) for triple in np.sort(rng.choice(own, count, replace=False)))
    return pairs
