"""A small random graph with novel entities in two models:
the input of a session and of initializers.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch

from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, VALID
from isi.initializers.context import InitContext, context_in_session
from isi.models.stack import Embedding
from stages.grid import GridPoints
from tests.small_graphs import (
    graph_of,
    insert_triples_of,
    points_of,
    random_counts,
    random_embedding,
)

ENTITIES, RELATIONS, DIMENSION = 16, 3, 8
#: Novel entities of two models. All training triples of 15 contain 0, which is novel: 15 is an
#: orphan in both. Entities 3 and 9 have no word vector.
NOVEL = np.array([[0, 4, 9], [0, 7, 12]])
ORPHAN, WORDLESS = 15, (3, 9)


def orphaning_graph() -> Graph:
    counts = random_counts(ORPHAN, RELATIONS, 60, seed=2)
    return graph_of(
        counts | {(ORPHAN, 1, 0): 2, (0, 2, ORPHAN): 1, (ORPHAN, 0, 5): 1}, ENTITIES, RELATIONS
    )


@dataclass(frozen=True)
class World:
    """The data of a session, with validation and test triples in ``splits``,
    which initializers must not see.
    """

    graph: Graph
    splits: np.ndarray
    theta0: Embedding
    insert_triples: np.ndarray
    words: np.ndarray


def world() -> World:
    """Random embeddings and word vectors; splits sampled as in the pipeline,
    except for the orphan's triples.
    """
    graph = orphaning_graph()
    splits = points_of(graph, 3, [5, 6]).splits
    splits[:, -3:] = TRAIN, TRAIN, VALID
    points = points_at(graph, splits)
    theta0 = random_embedding(2, ENTITIES, RELATIONS, DIMENSION)
    words = np.random.default_rng(1).normal(size=(ENTITIES, 6)).astype(np.float32)
    words[list(WORDLESS)] = 0
    known = replace(theta0, entity=theta0.entity * points.session(0).entities[..., None])
    return World(graph, splits, known, insert_triples_of(points), words)


def points_at(graph: Graph, splits: np.ndarray) -> GridPoints:
    return GridPoints("home", graph, 3, [5, 6], splits, NOVEL)


def seen(of: World) -> InitContext:
    """The input of initializers (``InitContext``) for a world."""
    points = points_at(of.graph, of.splits)
    given = map(torch.as_tensor, (NOVEL, of.insert_triples, of.words))
    return context_in_session(of.theta0, points.session(0), *given, 0, points.keys())


def insertion() -> InitContext:
    return seen(world())
