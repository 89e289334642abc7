"""Changes that break the tables and tensors of a small run, each with the expected message."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch

from isi.experiment.store import RUNS, THETA0
from isi.graph.graph import ENTITIES, TRIPLES
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import WORD_VECTORS
from isi.sources import KINDS, OBSERVATIONS
from isi.tables.table import Table, as_text
from tests.example_tables import Change
from tests.stage_run import NAME

Tensors = dict[str, torch.Tensor]
ChangeTensors = Callable[[Tensors], object]


def put(column: str, value: object, row: int = 0) -> Change:
    """A change: ``value`` in one row of a column."""

    def altered(frame: pd.DataFrame) -> pd.DataFrame:
        plain = as_text(frame)
        plain[column] = [
            value if number == row else old for number, old in enumerate(plain[column])
        ]
        return plain

    return altered


def at_end(column: str) -> Change:
    """A change: an id in the last row that is larger than all valid ids."""
    return lambda frame: put(column, 10**6, len(frame) - 1)(frame)


def doubled(frame: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([frame[:1], frame])


def less(rows: int) -> Change:
    return lambda frame: frame[rows:]


def as_test_and_train(frame: pd.DataFrame) -> pd.DataFrame:
    again = as_text(frame[:1]).assign(
        split=lambda row: "test" if row["split"].iloc[0] == "train" else "train"
    )
    return pd.concat([again, as_text(frame)])


def another_novel(frame: pd.DataFrame) -> pd.DataFrame:
    """Replace the entity of the first novel set, which has size 1."""
    return frame.assign(
        entity=[(int(frame["entity"][0]) + 1) % len(entities()), *frame["entity"][1:]]
    )


def entities() -> pd.DataFrame:
    return ENTITIES.read_text(experiment=NAME)


#: A title, the table, its change, and a pattern of the expected message.
CASES: list[tuple[str, Table, Change, str]] = [
    ("a count of 0", OBSERVATIONS, put("count", 0), "row 0 .count 0.: .*of at least 1"),
    ("a count of 2e9", OBSERVATIONS, put("count", 2 * 10**9), "1,000,000,000 observat"),
    ("a blank head", OBSERVATIONS, put("head", " "), "'head' to be a name"),
    ("a tail of 10 kB", OBSERVATIONS, put("tail", "x" * 10**4), "'tail' to be a name"),
    ("no relation", OBSERVATIONS, put("relation", None), "a value in column"),
    ("a kind twice", KINDS, doubled, "only one row with the same entity"),
    ("no kind", KINDS, put("kind", None), "a value in column 'kind'"),
    ("an entity renamed", ENTITIES, put("entity", "aaa"), "a name in entities"),
    ("a control character", ENTITIES, put("entity", "a\tb"), "no control character"),
    ("a triple doubled", TRIPLES, doubled, "only one row with the same head"),
    ("an unknown tail", TRIPLES, put("tail", "0", 0), "a name in entities"),
    ("a triple's count of 2e9", TRIPLES, put("count", 2 * 10**9), "1,000,000,000"),
    ("both train and test", SPLITS, as_test_and_train, "row 1 .*each once"),
    ("triple -1", SPLITS, put("triple", -1), "row 0 .triple -1.: .*of at least 0"),
    ("a triple above all", SPLITS, at_end("triple"), "expected ids below"),
    ("an unknown split", SPLITS, put("split", "dev"), "among train, valid, test"),
    (
        "all test",
        SPLITS,
        lambda f: f.assign(split="test"),
        "seed 0: .*at least one triple in train",
    ),
    (
        "seeds of splits changed",
        SPLITS,
        lambda f: f.assign(seed=f["seed"] + 1),
        "novel.*expected only seeds that have splits",
    ),
    ("an entity above all", NOVEL, put("entity", 10**6), "row 0 .*expected ids below"),
    ("a novel entity less", NOVEL, lambda f: f[:-1], "the number of novel entities to equal size"),
    ("nobody novel", NOVEL, lambda f: f[:0], "at least one set of novel entities"),
    ("a seed less", NOVEL, less(1), "the same seeds, and the same sessions"),
    ("session 0", NOVEL, lambda f: f.assign(session=0), "'session' of at least 1"),
    ("session 2 alone", NOVEL, lambda f: f.assign(session=2), "the same sessions from 1"),
    (
        "told of a known entity",
        NOVEL,
        another_novel,
        "insert_triples.* an entity that the session inserts",
    ),
    ("told triple above all", INSERT_TRIPLES, at_end("triple"), "expected ids below"),
    ("MRR* of 1.5", RUNS, put("mrr_star", 1.5), "row 0 .*'mrr_star' from 0 to 1"),
    ("MRR* null", RUNS, put("mrr_star", None), "null where 'queries' is 0"),
    ("an unknown scope", RUNS, put("scope", "some"), "'scope' among all, known"),
    ("no model of a seed", RUNS, lambda f: f[f["seed"] > 0], "a row of seed"),
]


def cut(name: str, dimension: int) -> ChangeTensors:
    """A change: only the first half of a tensor along a dimension."""
    return lambda t: t.update({name: t[name].narrow(dimension, 0, t[name].shape[dimension] // 2)})


VECTORS, WORDS = THETA0.path(experiment=NAME, size=2), WORD_VECTORS.path(experiment=NAME)
TENSOR_CASES: list[tuple[str, Path, ChangeTensors, str]] = [
    ("seeds relabelled", VECTORS, lambda t: t["seed"].add_(1), "the sessions' seeds"),
    ("seeds swapped", VECTORS, lambda t: t.update(seed=t["seed"].flip(0)), "the sessions' seeds"),
    (
        "rows shuffled",
        VECTORS,
        lambda t: t.update(entity=t["entity"].roll(1, 1)),
        "zeros for all others",
    ),
    (
        "a novel entity inside D0",
        VECTORS,
        lambda t: t["known"].fill_(True),
        "to be those of the session",
    ),
    (
        "a novel entity with a vector",
        VECTORS,
        lambda t: t["entity"].masked_fill_(~t["known"][..., None], 0.5),
        "zeros for all others",
    ),
    (
        "not a number",
        VECTORS,
        lambda t: t["entity"][0, 1, 2].fill_(torch.nan),
        r"tensor 'entity', \[0, 1, 2\]: expected finite numbers",
    ),
    ("a model less", VECTORS, cut("entity", 0), "in every tensor"),
    ("an entity less", VECTORS, cut("entity", 1), "tensor 'entity': expected float32 of shape"),
    (
        "vectors of half the length",
        VECTORS,
        cut("entity", 2),
        "tensor 'relation': expected float32 of shape",
    ),
    (
        "a relation less",
        VECTORS,
        cut("relation", 1),
        "tensor 'relation': expected float32 of shape",
    ),
    (
        "double precision",
        VECTORS,
        lambda t: t.update(entity=t["entity"].double()),
        "expected float32 .*, got float64",
    ),
    (
        "an infinite word vector",
        WORDS,
        lambda t: t["vectors"][0, 3].fill_(torch.inf),
        "expected finite numbers",
    ),
    (
        "half of the word vectors",
        WORDS,
        cut("vectors", 0),
        "tensor 'vectors': expected float32 of shape",
    ),
]
