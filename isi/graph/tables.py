"""Tables of the graph of an experiment, of its word vectors, and of its sessions."""

from __future__ import annotations

from dataclasses import replace

from isi.graph.sessions import SPLITS as SPLIT_NAMES
from isi.tables.rules import at_least, counted, in_blocks, named, one_of, unique
from isi.tables.table import INT, NAME, TEXT, Table, TensorFile

#: Row numbers are ids, here and of triples; rows of one source stand together, first those that others extend.
ENTITIES = Table(
    "data/graph/{experiment}/entities.parquet",
    {"entity": TEXT, "kind": NAME, "source": NAME, "phrase": TEXT},
    key=["entity"],
    checks=[*named("entity", "kind", "source", "phrase"), *in_blocks("source", "entity")],
)
TRIPLES = Table(
    "data/graph/{experiment}/triples.parquet",
    {"head": NAME, "relation": NAME, "tail": NAME, "count": INT, "source": NAME},
    key=["head", "relation", "tail"],
    checks=[*named("head", "relation", "tail", "source"), *counted(), *in_blocks("source", "head", "relation", "tail")],
)
#: The same of a graph of the second pipeline.
GRAPH_ENTITIES = replace(ENTITIES, template="data/beyond/graphs/{graph}/entities.parquet")
GRAPH_TRIPLES = replace(TRIPLES, template="data/beyond/graphs/{graph}/triples.parquet")
#: Tensor ``vectors``, shape (E, w), float32; zeros where an entity has no word vector.
WORD_VECTORS = TensorFile("data/words/{experiment}/vectors.safetensors")
#: Which phrase or words of it have vectors.
COVERAGE = Table(
    "data/words/{experiment}/coverage.parquet",
    {"entity": TEXT, "phrase": TEXT, "served_by": TEXT},
    key=["entity"],
    nullable=["served_by"],
)
SPLITS = Table(
    "data/sessions/{experiment}/splits.parquet",
    {"seed": INT, "triple": INT, "split": NAME},
    key=["seed", "triple"],
    ordered=True,
    checks=[*at_least(0, "seed", "triple"), *one_of("split", SPLIT_NAMES)],
)
#: ``session``: in which the entity is inserted, from 1; Θ⁰ is trained in session 0.
NOVEL = Table(
    "data/sessions/{experiment}/novel.parquet",
    {"size": INT, "seed": INT, "entity": INT, "session": INT},
    key=["size", "seed", "session", "entity"],
    ordered=True,
    checks=[*at_least(1, "size", "session"), *at_least(0, "seed", "entity"), *unique("size", "seed", "entity")],
)
INSERT_TRIPLES = Table(
    "data/sessions/{experiment}/insert_triples.parquet",
    {"size": INT, "seed": INT, "entity": INT, "triple": INT, "session": INT},
    key=["size", "seed", "session", "entity", "triple"],
    ordered=True,
    checks=[*at_least(1, "size", "session"), *at_least(0, "seed", "entity", "triple")],
)
