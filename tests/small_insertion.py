"""A small graph with novel entities in two models, at random, as a step of learning and as initializers see it."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from isi.experiment.grid import GridPoints
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, VALID
from isi.initializers.api import InitContext, context_of
from isi.models.stack import Embedding
from tests.small_graphs import graph_of, insert_triples_of, points_of, random_counts, random_embedding

ENTITIES, RELATIONS, DIMENSION = 16, 3, 8
#: Two models; in training 15 hangs on 0 alone, so that it is an orphan of both once 0 is novel.
#: 3 and 9 have no word vector.
NOVEL = np.array([[0, 4, 9], [0, 7, 12]])
ORPHAN, WORDLESS = 15, (3, 9)


def orphaning_graph() -> Graph:
    counts = random_counts(ORPHAN, RELATIONS, 60, seed=2)
    return graph_of(counts | {(ORPHAN, 1, 0): 2, (0, 2, ORPHAN): 1, (ORPHAN, 0, 5): 1}, ENTITIES, RELATIONS)


@dataclass(frozen=True)
class World:
    """What a step of learning knows, and more: validation and test triples are in the splits."""

    graph: Graph
    splits: np.ndarray
    theta0: Embedding
    insert_triples: np.ndarray
    words: np.ndarray


def world() -> World:
    """Embeddings and word vectors at random; splits as the pipeline draws them, but for the orphan's."""
    graph = orphaning_graph()
    splits = points_of(graph, 3, [5, 6]).splits
    splits[:, -3:] = TRAIN, TRAIN, VALID
    points = points_at(graph, splits)
    theta0 = random_embedding(2, ENTITIES, RELATIONS, DIMENSION)
    words = np.random.default_rng(1).normal(size=(ENTITIES, 6)).astype(np.float32)
    words[list(WORDLESS)] = 0
    known = replace(theta0, entity=theta0.entity * points.session(0).entities[..., None])
    return World(graph, splits, known, insert_triples_of(points)[:, 1:], words)


def points_at(graph: Graph, splits: np.ndarray) -> GridPoints:
    return GridPoints("home", graph, 3, [5, 6], splits, NOVEL[:, None])


def seen(of: World) -> InitContext:
    """What initializers are shown of it."""
    points = points_at(of.graph, of.splits)
    given = map(torch.as_tensor, (NOVEL, of.insert_triples, of.words))
    return context_of(of.theta0, points.session(0), *given, 0, points.keys())


def insertion() -> InitContext:
    return seen(world())
