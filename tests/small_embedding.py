"""A small embedding with names, and calls of ``isi.insert`` on it."""

from typing import Any

import numpy as np

import isi
from isi.insertion.result import Inserted
from tests.small_graphs import random_embedding

ENTITIES, RELATIONS, DIMENSION = 12, 3, 8
KNOWN = [f"e{number}" for number in range(ENTITIES)]
NEW = ["cup", "mug"]
BETWEEN = ["in", "on", "has"]
TRIPLES = [("cup", "in", "e1"), ("e3", "on", "cup"), ("mug", "has", "e2"), ("cup", "on", "mug")]
KNOWN_TRIPLES = [
    ("e0", "in", "e1"),
    ("e2", "on", "e3"),
    ("e4", "has", "e5"),
    ("e6", "in", "e7"),
    ("e1", "on", "e2"),
]


def tables(dtype: type[np.floating[Any]] = np.float32) -> dict[str, np.ndarray]:
    stack = random_embedding(1, ENTITIES, RELATIONS, DIMENSION)
    return {
        "entities": stack.entity[0].numpy().astype(dtype),
        "relations": stack.relation[0].numpy().astype(dtype),
    }


def words() -> np.ndarray:
    return np.random.default_rng(0).standard_normal((ENTITIES + len(NEW), 6)).astype(np.float32)


def named(**changed: Any) -> dict[str, Any]:
    """Arguments of a call with names of entities and relations in place of ids."""
    return {
        **tables(),
        "triples": TRIPLES,
        "new": NEW,
        "model": "analogy",
        "entity_names": KNOWN,
        "relation_names": BETWEEN,
        "known_triples": KNOWN_TRIPLES,
        **changed,
    }


def call(**changed: Any) -> Inserted:
    return isi.insert(**named(**changed))


NAMES = {"entity_names": [*KNOWN, *NEW], "relation_names": BETWEEN}


#: DistMult in one dimension: f = h · r · t.
LINE: dict[str, Any] = {
    "entities": np.array([[1.0], [2.0], [3.0], [-4.0]], np.float32),
    "relations": np.array([[1.0]], np.float32),
    "model": "distmult",
}


def on_a_line(triples: Any = ((4, 0, 1),)) -> Inserted:
    """The result for new entity 4 at 0.5, the mean of the known vectors,
    with the insert triple (4, 0, 1).
    """
    return isi.insert(**LINE, triples=list(triples), new=1, initializer="mean")
