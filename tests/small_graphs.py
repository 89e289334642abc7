"""Small graphs, and grids of sessions on them."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from isi.graph.graph import Graph
from isi.graph.sessions import split
from isi.models.model import Model, make_model
from isi.models.scoring import DenseTriples
from isi.models.stack import Embedding
from stages.grid import GridPoints
from stages.make_sessions import sample_insert_triples, sample_novel

#: Ids of head, relation and tail.
Triple = tuple[int, int, int]
InsertFrom = Literal["train", "all"]


def graph_of(counts: Mapping[Triple, int], entities: int, relations: int) -> Graph:
    """A graph with triples in the order of ``counts``; entity e has kind e mod 3."""
    return Graph(
        [f"entity {number}" for number in range(entities)],
        [f"relation {number}" for number in range(relations)],
        torch.tensor(list(counts)),
        torch.tensor(list(counts.values())),
        torch.arange(entities) % 3,
    )


def score_all(embedding: Embedding) -> Tensor:
    """Scores of every triple; shape (M, R, E, E)."""
    entity, relation = embedding.entity, embedding.relation
    return embedding.model.scores(entity, relation, DenseTriples.of(entity, relation))[0]


def random_counts(entities: int, relations: int, triples: int, seed: int) -> dict[Triple, int]:
    """Counts from 1 to 4 of a ring through all entities, with relations in turn,
    and of further random triples.
    """
    rng = np.random.default_rng(seed)
    counts = {
        (e, e % relations, (e + 1) % entities): int(rng.integers(1, 5)) for e in range(entities)
    }
    while len(counts) < min(triples, relations * entities**2):
        head, relation, tail = rng.integers((entities, relations, entities)).tolist()
        counts[head, relation, tail] = int(rng.integers(1, 5))
    return counts


def random_graph(entities: int, relations: int, triples: int, seed: int = 0) -> Graph:
    return graph_of(random_counts(entities, relations, triples, seed), entities, relations)


#: The model in tests that do not compare models.
ANALOGY = make_model("analogy", {}, "models.analogy")


def as_stored(graph: Graph) -> Graph:
    """The same graph with entities and triples in alphabetical order of names, as in tables."""
    names = [f"entity {number:03d}" for number in range(len(graph.entities))]
    order = torch.tensor(sorted(range(len(graph.triples)), key=graph.triples.tolist().__getitem__))
    return Graph(names, graph.relations, graph.triples[order], graph.counts[order], graph.kinds)


def random_embedding(
    models: int,
    entities: int,
    relations: int,
    dimension: int,
    seed: int = 0,
    model: Model = ANALOGY,
) -> Embedding:
    generator = torch.Generator().manual_seed(seed)
    entity = torch.randn(models, entities, dimension, generator=generator)
    return Embedding(
        entity, torch.randn(models, relations, model.width(dimension), generator=generator), model
    )


def points_of(
    graph: Graph, size: int, seeds: Sequence[int], insert_from: InsertFrom = "train"
) -> GridPoints:
    """Grid points sampled as in the pipeline, with shares of 0.2 for validation and for test."""
    splits = np.stack([split(graph, 0, seed, 0.2, 0.2) for seed in seeds])
    everyone = np.arange(len(graph.entities))
    novel = np.stack([sample_novel(everyone, 0, size, seed) for seed in seeds])
    points = GridPoints("home", graph, size, list(seeds), splits, novel)
    return replace(points, insert_triples=insert_triples_of(points, insert_from))


def insert_triples_of(points: GridPoints, insert_from: InsertFrom = "train") -> np.ndarray:
    """Insert triples drawn as in the pipeline: model, place in ``novel``, triple; shape (I, 3)."""
    rows = list[tuple[int, int, int]]()
    for model, seed in enumerate(points.seeds):
        splits, novel = points.splits[model], points.novel[model]
        pairs = sample_insert_triples(points.graph, splits, novel, 0, seed, 0.5, insert_from)
        rows += [(model, novel.tolist().index(entity), triple) for entity, triple in pairs]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def generator(purpose: str, *key: int) -> np.random.Generator:
    """NumPy's generator, seeded as in ``isi.random`` by root 0, a purpose and a key."""
    return np.random.default_rng(np.random.SeedSequence([0, zlib.crc32(purpose.encode()), *key]))


def dense(relation: Tensor) -> Tensor:
    """The matrix W, (d, d), of a relation of ANALOGY, (d,),
    entry by entry from vᵀW (docs/method.md).
    """
    dimension = len(relation)
    half, quarter = dimension // 2, dimension // 4
    matrix = torch.zeros(dimension, dimension, dtype=relation.dtype)
    for place in range(half):
        matrix[place, place] = relation[place]
    for a in range(half, half + quarter):
        b, x, y = a + quarter, relation[a], relation[a + quarter]
        matrix[a, a], matrix[b, a] = x, -y  # the new a: a·x - b·y
        matrix[a, b], matrix[b, b] = y, x  # the new b: a·y + b·x
    return matrix
