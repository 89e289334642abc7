"""Sessions as tables: which entities count as added, refused input, and one split for each seed."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from isi.errors import InputError
from isi.graph.graph import Graph
from isi.tables.table import Table
from stages.files import INSERT_TRIPLES, NOVEL, SPLITS
from stages.make_sessions import SessionsOf, Shares, session_tables
from tests.small_graphs import random_graph

KEY = "experiments.home.sessions"
NUMBER = 12
GRAPH = random_graph(NUMBER, 2, 80)
SHARES = Shares(valid=0.1, test=0.1, insert_fraction=0.5)
#: The second entity is of another source than the first.
TWO_SOURCES = ["a", "b", *["a", "b"] * (NUMBER // 2 - 1)]
ADDED = set(range(1, NUMBER, 2))


def sessions(
    graph: Graph = GRAPH, sources: list[str] = TWO_SOURCES, **changed: Any
) -> dict[Table, pd.DataFrame]:
    entities = pd.DataFrame(
        {"kind": ["object", "room", "material"] * (NUMBER // 3), "source": sources}
    )
    values: dict[str, Any] = {"novel": "any", "sizes": [2], "seeds": 8, **changed}
    return session_tables(graph, entities, SessionsOf(**values), SHARES, 3, KEY)


def refusal(**changed: Any) -> tuple[object, ...]:
    with pytest.raises(InputError) as refused:
        sessions(**changed)
    return refused.value.args


def test_a_graph_without_triples_is_refused_by_its_key() -> None:
    assert refusal(graph=GRAPH.part(np.array([], dtype=int))) == (
        "params.yaml",
        KEY,
        "expected a graph with triples",
    )


@pytest.mark.parametrize(
    ("changed", "candidates"),
    [
        ({"sizes": [1, 12]}, 12),
        ({"novel": "added", "sizes": [7]}, 6),
        ({"novel": "added", "sizes": [1], "sources": ["a"] * NUMBER}, 0),
    ],
)
def test_more_novel_entities_than_there_may_be_are_refused_by_their_key(
    changed: dict[str, Any], candidates: int
) -> None:
    few = (
        f"expected a smaller size: {candidates} candidates; one must stay known unless novel: added"
    )
    assert refusal(**changed) == ("params.yaml", f"{KEY}.sizes", few)


def test_all_added_may_be_novel_at_once_and_one_known_entity_is_enough_otherwise() -> None:
    assert set(sessions(novel="added", sizes=[6])[NOVEL]["entity"]) == ADDED
    assert len(sessions(sizes=[11], seeds=1)[NOVEL]) == 11


@pytest.mark.parametrize("insert_from", ["train", "all"])
def test_added_are_those_of_another_source_and_take_no_part_where_they_are_not_drawn(
    insert_from: str,
) -> None:
    tables = sessions(novel="added", sizes=[4], insert_from=insert_from)
    assert set(tables[NOVEL]["entity"]) == ADDED
    ends = GRAPH.triples[:, [0, 2]].numpy()
    for seed, rows in tables[SPLITS].groupby("seed"):
        novel = tables[NOVEL][tables[NOVEL]["seed"] == seed]
        absent = list(ADDED - set(novel["entity"]))
        assert rows["triple"].tolist() == np.flatnonzero(~np.isin(ends, absent).any(1)).tolist()
        number = rows["split"].value_counts()
        assert number["valid"] == number["test"] == round(0.1 * len(rows))
        given = tables[INSERT_TRIPLES][tables[INSERT_TRIPLES]["seed"] == seed]
        usable = rows[(rows["split"] == "train") | (insert_from == "all")]
        assert set(given["triple"]) <= set(usable["triple"])
        assert (ends[given["triple"]] == given["entity"].to_numpy()[:, None]).any(1).all()
        assert len(given.merge(novel, on="entity")) == len(given)


def test_all_take_part_where_others_than_the_added_are_novel() -> None:
    one, two = sessions(sources=["a"] * NUMBER), sessions()
    for table in one:
        pd.testing.assert_frame_equal(one[table], two[table])
    assert sorted(two[SPLITS]["triple"].unique()) == list(range(len(GRAPH.triples)))
