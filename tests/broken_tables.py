"""Changes that break the tables and tensors of a small run, each with the expected message."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch
import yaml

from isi.tables.table import Table, as_text
from stages.files import (
    ENTITIES,
    INSERT_TRIPLES,
    KINDS,
    NOVEL,
    OBSERVATIONS,
    SPLITS,
    TRIPLES,
    WORD_VECTORS,
)
from stages.store import INITIAL_VECTORS, JOINT, RUNS, THETA0
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


TABLES = {
    "observations": OBSERVATIONS,
    "kinds": KINDS,
    "entities": ENTITIES,
    "triples": TRIPLES,
    "splits": SPLITS,
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
    ("size 0", NOVEL, lambda f: f.assign(size=0), "'size' of at least 1"),
    ("a split of no triple", SPLITS, put("triple", 10**6, -1), "row number of triples"),
    ("a novel entity of no row", NOVEL, put("entity", 10**6, -1), "a row number of entities"),
    ("a novel set of no seed", NOVEL, put("seed", 10**6, -1), "a seed of splits"),
    ("a novel set with one too few", NOVEL, lambda f: f[:-1], "as many entities .* as its size"),
    (
        "an insert triple of no row",
        INSERT_TRIPLES,
        put("triple", 10**6, -1),
        "a row number of triples",
    ),
    ("an insert triple of none", INSERT_TRIPLES, put("entity", 10**6, -1), "an entity of this set"),
    ("no model of a seed", RUNS, lambda f: f[f["seed"] > 0], "a row of each seed"),
]


VECTORS, WORDS = THETA0.path(experiment=NAME, size=2), WORD_VECTORS.path(experiment=NAME)
OF_JOINT = JOINT.path(experiment=NAME)
INSERTED = INITIAL_VECTORS.path(experiment=NAME, initializer="rs")


def without_the_last(*names: str) -> ChangeTensors:
    """A change: these tensors (no name: all) without their last place."""

    def cut(tensors: Tensors) -> None:
        for name in names or list(tensors):
            tensors[name] = tensors[name][:-1].clone()

    return cut


def without_an_entity(tensors: Tensors) -> None:
    tensors["entity"] = tensors["entity"][:, :-1].clone()


TENSOR_CASES: list[tuple[str, Path, ChangeTensors, str]] = [
    (
        "not a number",
        VECTORS,
        lambda t: t["entity"][0, 1, 2].fill_(torch.nan),
        r"tensor 'entity', \[0, 1, 2\]: expected finite numbers",
    ),
    (
        "an infinite word vector",
        WORDS,
        lambda t: t["vectors"][0, 3].fill_(torch.inf),
        "expected finite numbers",
    ),
    ("vectors of a seed too few", VECTORS, without_the_last(), "expected seed"),
    ("an entity too few", VECTORS, without_an_entity, "a row of each entity"),
    ("a joint model of an entity too few", OF_JOINT, without_an_entity, "a row of each entity"),
    ("a word vector too few", WORDS, without_the_last(), "a row of each entity"),
    ("an inserted set too few", INSERTED, without_the_last(), "a vector of each novel entity"),
]
