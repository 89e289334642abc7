"""Changes that break the tables and tensors of a small run, each with the expected message."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch
import yaml

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
    """A change: ``value`` in one row of a column; row -1: the last."""

    def altered(frame: pd.DataFrame) -> pd.DataFrame:
        plain = as_text(frame)
        values = list(plain[column])
        values[row] = value
        return plain.assign(**{column: values})

    return altered


def doubled(frame: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([frame[:1], frame])


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


TABLES = {
    "observations": OBSERVATIONS,
    "kinds": KINDS,
    "entities": ENTITIES,
    "triples": TRIPLES,
    "splits": SPLITS,
    "novel": NOVEL,
    "insert_triples": INSERT_TRIPLES,
    "runs": RUNS,
}
#: Other values in single rows.
VALUES = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
#: A title, the table, its change, and a pattern of the expected message.
CASES: list[tuple[str, Table, Change, str]] = [
    *(
        (
            case["what"],
            TABLES[case["table"]],
            put(case["column"], case["value"], case.get("row", 0)),
            case["says"],
        )
        for case in VALUES
    ),
    ("a tail of 10 kB", OBSERVATIONS, put("tail", "x" * 10**4), "'tail' to be a name"),
    ("a kind twice", KINDS, doubled, "only one row with the same entity"),
    ("a triple doubled", TRIPLES, doubled, "only one row with the same head"),
    ("both train and test", SPLITS, as_test_and_train, "row 1 .*each once"),
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
    ("a novel entity less", NOVEL, lambda f: f[:-1], "the number of novel entities to equal size"),
    ("nobody novel", NOVEL, lambda f: f[:0], "at least one set of novel entities"),
    ("a seed less", NOVEL, lambda f: f[1:], "the same seeds, and the same sessions"),
    ("session 0", NOVEL, lambda f: f.assign(session=0), "'session' of at least 1"),
    ("session 2 alone", NOVEL, lambda f: f.assign(session=2), "the same sessions from 1"),
    (
        "given of a known entity",
        NOVEL,
        another_novel,
        "insert_triples.* an entity that the session inserts",
    ),
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
