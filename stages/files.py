"""Files that experiments are made of, which several stages read: their paths, columns and rules.

A file of one stage is declared beside it. These stand apart, so that no stage depends on the code
of another for its table alone.
"""

from pathlib import Path

from isi.tables import paths
from isi.tables.rules import (
    COUNT,
    FROM_0,
    FROM_1,
    NAME,
    TEXT,
    ColumnType,
    one_of,
)
from isi.tables.table import Table, TensorFile

REPORTS = Path("reports")
DEFINITIONS = paths.RAW / "words" / "definitions.csv"
PAPER = paths.RAW / "paper" / "values.yaml"
#: One row per triple of an instance, or per tally; ``count`` is the number of observations.
OBSERVATIONS = Table(
    "data/observations/{source}.parquet",
    {
        "scene": ColumnType(NAME.type, nullable=True),
        "room": NAME.optional,
        "instance": ColumnType(TEXT.type, nullable=True),
        "head": NAME,
        "relation": NAME,
        "tail": NAME,
        "count": COUNT,
    },
)
#: One row per entity of a source; ``phrase`` is looked up in the word vectors.
KINDS = Table(
    "data/observations/{source}.entities.parquet",
    {"entity": TEXT, "kind": NAME, "phrase": TEXT},
    key=["entity"],
)
#: Row numbers are ids, here and in ``TRIPLES``. Rows are grouped by source; the extended source is
#: first.
ENTITIES = Table(
    "data/graph/{experiment}/entities.parquet",
    {"entity": TEXT, "kind": NAME, "source": NAME, "phrase": TEXT},
    key=["entity"],
)
TRIPLES = Table(
    "data/graph/{experiment}/triples.parquet",
    {"head": NAME, "relation": NAME, "tail": NAME, "count": COUNT, "source": NAME},
    key=["head", "relation", "tail"],
)
#: Tensor ``vectors``, shape (E, w), float32; zeros where an entity has no word vector.
WORD_VECTORS = TensorFile("data/words/{experiment}/vectors.safetensors")
SPLIT_NAMES = ("train", "valid", "test")

SPLITS = Table(
    "data/sessions/{experiment}/splits.parquet",
    {"seed": FROM_0, "triple": FROM_0, "split": one_of(*SPLIT_NAMES)},
    key=["seed", "triple"],
    ordered=True,
)
NOVEL = Table(
    "data/sessions/{experiment}/novel.parquet",
    {"size": FROM_1, "seed": FROM_0, "entity": FROM_0},
    key=["size", "seed", "entity"],
    ordered=True,
)
INSERT_TRIPLES = Table(
    "data/sessions/{experiment}/insert_triples.parquet",
    {"size": FROM_1, "seed": FROM_0, "entity": FROM_0, "triple": FROM_0},
    key=["size", "seed", "entity", "triple"],
    ordered=True,
)
