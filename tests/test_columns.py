"""Columns of triples are found by their names, and refused by them,
in every function that takes triples.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import isi
from isi.columns import triple_columns
from isi.errors import InputError
from isi.graph.files import read_graph
from isi.home.home import Home
from isi.home.train import tables_of
from isi.insertion.arguments import listed_triples
from tests.small_bundle import BETWEEN, ENTITIES, LABELS, NAMES, TRIPLES, small

FACTS = [("jug", "atLocation", "kitchen"), ("jug", "hasAffordance", "turn on")]
ARRAYS: dict[str, Any] = {"model": "distmult", "relation_names": BETWEEN}


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (["head", "relation", "tail"], [0, 1, 2]),
        (["tail", "head", "count", "relation"], [1, 3, 0]),
        (["H", "R", "T"], [0, 1, 2]),
        (["Subject", "Object", "Predicate"], [0, 2, 1]),
        (["from", "to", "rel"], [0, 2, 1]),
        (["source", "target", "label"], [0, 2, 1]),
        (["subjectLabel", "predicateLabel", "objectLabel"], [0, 1, 2]),
        (["?valueLabel", "?propLabel", "?item"], [2, 1, 0]),
        (["e1", "rel", "e2", "Count"], [0, 1, 2]),
        (["node1", "label", "node2"], [0, 1, 2]),
        (["head", "relation", "object"], [0, 1, 2]),
        (["Head_Entity", "relation_id", "tailEntity", "scene"], [0, 1, 2]),
        ([" Head ", "rel", "TAIL"], [0, 1, 2]),
    ],
)
def test_columns_are_found_by_name(columns: list[str], expected: list[int]) -> None:
    assert triple_columns(columns) == expected


@pytest.mark.parametrize(
    "columns",
    [
        ["a", "b", "c"],
        ["head", "tail"],
        ["from", "to", "source", "target", "rel"],
        ["head", "rel", "predicate", "tail"],
        ["Head", "head", "rel", "tail"],
        [],
    ],
)
def test_columns_that_do_not_fit_are_refused(columns: list[str]) -> None:
    with pytest.raises(InputError, match="expected the columns head, relation, tail") as error:
        triple_columns(columns)
    assert all(repr(name) in str(error.value) for name in columns)


def train(facts: Any) -> object:
    return tables_of(facts).triples.values.tolist()


def insert(facts: Any) -> object:
    return isi.insert(
        ENTITIES, LABELS, facts, new=["jug"], entity_names=NAMES, initializer="map", **ARRAYS
    ).entities.tolist()


def insert_beside_known(facts: Any) -> object:
    known = (
        facts.replace("jug", "kettle")
        if isinstance(facts, pd.DataFrame)
        else [("kettle", *row[1:]) for row in facts]
    )
    return isi.insert(
        ENTITIES,
        LABELS,
        FACTS,
        new=["jug"],
        entity_names=NAMES,
        known_triples=known,
        initializer="rs",
        options={"k": 9},
        **ARRAYS,
    ).entities.tolist()


def live_insert(facts: Any) -> object:
    home = Home(small())
    home.tell(facts, entities="jug")
    return [row.fact for row in home.facts()[len(TRIPLES) :]]


def live_tell(facts: Any) -> object:
    home = Home(small())
    home.tell([("jug", "atLocation", "bedroom")], entities="jug")
    home.tell(facts, new="refuse")
    return [row.fact for row in home.facts()[len(TRIPLES) :]]


def pykeen_insert(facts: Any) -> object:
    pytest.importorskip("pykeen")
    from pykeen.models import DistMult
    from pykeen.triples import TriplesFactory

    known = np.array([["kettle", "atLocation", "kitchen"], ["bed", "hasAffordance", "turn on"]])
    factory = TriplesFactory.from_labeled_triples(known)
    model = DistMult(triples_factory=factory, embedding_dim=4, random_seed=0)
    done = isi.pykeen.insert(model, factory, facts, initializer="mean")
    return done.rows.details.insert_triples.tolist()


@pytest.mark.parametrize(
    "function",
    [
        train,
        insert,
        insert_beside_known,
        live_insert,
        live_tell,
        pykeen_insert,
    ],
)
def test_every_function_reads_columns_by_name(function: Callable[[Any], object]) -> None:
    expected = function(FACTS)
    frame = pd.DataFrame(FACTS, columns=["Subject", "Predicate", "Object"])
    assert function(frame[["Object", "Subject", "Predicate"]]) == expected
    assert function(pd.DataFrame(FACTS)) == expected
    with pytest.raises(InputError, match="columns: expected the columns"):
        function(frame.rename(columns={"Predicate": "sort"}))


@pytest.mark.parametrize("column", ["weight", "n", "split", "label", "headLabel"])
def test_other_columns_are_refused_in_frames_as_in_files(column: str, tmp_path: Path) -> None:
    frame = pd.DataFrame(FACTS, columns=["head", "relation", "tail"]).assign(**{column: "train"})
    for facts in (frame, pa.table(frame)):
        with pytest.raises(InputError, match=repr(column)):
            train(facts)
    frame.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(InputError, match=repr(column)):
        read_graph([tmp_path / "t.csv"])


FORMS: dict[str, Callable[[pd.DataFrame], Any]] = {
    "pyarrow": pa.table,
    "record batch": pa.RecordBatch.from_pandas,
    "reader of batches": lambda frame: pa.table(frame).to_reader(),
    "backed by pyarrow": lambda frame: frame.convert_dtypes(dtype_backend="pyarrow"),
    "nullable": lambda frame: frame.astype("string"),
    "categories": lambda frame: frame.astype("category"),
}


@pytest.mark.parametrize("form", FORMS)
def test_tables_of_arrow_and_missing_values_are_read_as_frames_are(form: str) -> None:
    frame = pd.DataFrame(FACTS, columns=["head", "relation", "tail"])
    assert train(FORMS[form](frame[frame["head"] == "jug"])) == train(FACTS)
    incomplete = pd.DataFrame(
        [*FACTS, ("jug", "atLocation", None)], columns=["head", "relation", "tail"]
    )
    for function in (train, insert):
        with pytest.raises(InputError, match=r"triple 2: tail.*[Nn]one"):
            function(FORMS[form](incomplete))


@pytest.mark.parametrize("form", ["pyarrow", "nullable", "backed by pyarrow"])
def test_ids_beside_counts_are_read_from_tables_of_arrow(form: str) -> None:
    ids = pd.DataFrame([(0, 1, 2), (3, 0, 1)], columns=["h", "r", "t"]).assign(count=[1, 2])
    table = ids.convert_dtypes() if form == "nullable" else FORMS[form](ids)
    assert listed_triples(table).tolist() == [[0, 1, 2], [3, 0, 1]]  # type: ignore[union-attr]


@pytest.mark.parametrize("column", ["count", "Count"])
def test_counts_are_read_in_any_table(column: str) -> None:
    frame = pd.DataFrame(FACTS, columns=["h", "r", "t"]).assign(**{column: [3, 1]})
    assert sorted(tables_of(frame).triples["count"]) == [1, 3]
