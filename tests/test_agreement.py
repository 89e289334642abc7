"""Rules between the tables of one experiment, by hand on a small graph."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isi.errors import InputError
from isi.graph.graph import Graph
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.tables import checks
from tests.small_graphs import graph_of

FILE = Path("data/a.parquet")
#: Triples 0: 0-1, 1: 1-2, 2: 2-3, 3: 3-0, 4: 0-2 of relation 0, and 5: 1-1 of relation 1.
GRAPH: Graph = graph_of(
    {(0, 0, 1): 1, (1, 0, 2): 1, (2, 0, 3): 1, (3, 0, 0): 1, (0, 0, 2): 1, (1, 1, 1): 1}, entities=4, relations=2
)
HOME = np.array(["home"] * 4)


def novel(*rows: tuple[int, int, int, int]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["size", "seed", "entity", "session"], dtype=np.int64)


def told(*rows: tuple[int, int, int, int, int]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["size", "seed", "entity", "triple", "session"], dtype=np.int64)


def split(*codes: int) -> dict[int, np.ndarray]:
    return {0: np.array(codes, dtype=np.int8)}


def refused(says: str) -> pytest.RaisesExc[InputError]:
    return pytest.raises(InputError, match=rf"^data/a\.parquet: {says}")


def test_every_triple_of_ones_own_graph_has_a_split() -> None:
    checks.splits_are_whole(FILE, split(0, 1, 2, 0, 0, 0), GRAPH, HOME, novel())
    with refused("seed 0, triple 2: has no split"):
        checks.splits_are_whole(FILE, split(0, 1, OUT, 0, 0, OUT), GRAPH, HOME, novel())


def test_triples_of_added_entities_have_one_where_they_are_drawn_and_nowhere_else() -> None:
    sources = np.array(["home", "home", "shop", "shop"])
    drawn = novel((1, 0, 3, 1), (1, 1, 2, 1))
    checks.splits_are_whole(FILE, split(0, OUT, OUT, 0, OUT, 0), GRAPH, sources, drawn)
    with refused("seed 0, triple 1: has a split"):
        checks.splits_are_whole(FILE, split(0, 0, OUT, 0, OUT, 0), GRAPH, sources, drawn)
    with refused("seed 0, triple 3: has no split"):
        checks.splits_are_whole(FILE, split(0, OUT, OUT, OUT, OUT, 0), GRAPH, sources, drawn)


def test_every_entity_and_relation_that_takes_part_has_a_training_triple() -> None:
    checks.everyone_is_trained(FILE, split(TRAIN, VALID, TRAIN, TEST, OUT, TRAIN), GRAPH)
    with refused("seed 0: expected a triple of 'entity 3' in train"):
        checks.everyone_is_trained(FILE, split(TRAIN, TRAIN, VALID, TEST, OUT, TRAIN), GRAPH)
    with refused("seed 0: expected a triple of 'relation 1' in train"):
        checks.everyone_is_trained(FILE, split(TRAIN, TRAIN, TRAIN, TEST, OUT, VALID), GRAPH)
    checks.everyone_is_trained(FILE, split(TRAIN, TRAIN, OUT, OUT, OUT, OUT), GRAPH)  # entity 3 takes no part


@pytest.mark.parametrize(("codes", "missing"), [((0, 0), "valid"), ((0, 1), "test"), ((1, 2), "train")])
def test_every_seed_has_triples_in_every_split(codes: tuple[int, ...], missing: str) -> None:
    with refused(f"seed 0: expected triples in {missing}"):
        checks.every_split_is_there(FILE, split(*codes))
    checks.every_split_is_there(FILE, split(*codes, 0, 1, 2))


def test_sets_are_as_large_as_they_say_and_sizes_have_the_same_cells() -> None:
    whole = [(1, 0, 3, 1), (1, 0, 2, 2), (2, 0, 0, 1), (2, 0, 1, 1), (2, 0, 2, 2), (2, 0, 3, 2)]
    checks.sets_are_whole(FILE, novel(*whole))
    with refused("expected at least one set of novel entities"):
        checks.sets_are_whole(FILE, novel())
    with refused(r"row 4 \(size 2, seed 0, session 2\): expected as many rows"):
        checks.sets_are_whole(FILE, novel(*whole[:-1]))
    for some in (whole[:-2], whole[1:], [*whole, (2, 1, 0, 1), (2, 1, 1, 1)]):
        with refused("expected the same seeds, and the same sessions"):
            checks.sets_are_whole(FILE, novel(*some))


def test_what_is_told_is_of_an_entity_that_is_inserted_and_of_another_that_is_known_by_then() -> None:
    drawn = novel((1, 0, 0, 1), (1, 0, 2, 2))
    checks.told_of_their_entity(FILE, told((1, 0, 0, 0, 1), (1, 0, 2, 4, 2)), drawn, GRAPH)  # 0 is known by then
    checks.told_of_their_entity(FILE, told(), drawn, GRAPH)
    for row, says in (
        ((1, 0, 1, 0, 1), "expected an entity that the session inserts"),  # who is known
        ((1, 0, 0, 0, 2), "expected an entity that the session inserts"),  # in another session
        ((1, 1, 0, 0, 1), "expected an entity that the session inserts"),  # of another seed
        ((1, 0, 0, 1, 1), "expected the entity at one end of the triple"),
        ((1, 0, 0, 4, 1), "expected the other end to be known by then"),  # 2 comes in the next
    ):
        shown = f"size {row[0]}, seed {row[1]}, entity {row[2]}, triple {row[3]}"
        with refused(rf"row 0 \({shown}\): {says}"):
            checks.told_of_their_entity(FILE, told(row), drawn, GRAPH)


def test_a_triple_with_the_same_entity_at_both_ends_tells_nothing() -> None:
    with refused(r".*expected the entity at one end"):
        checks.told_of_their_entity(FILE, told((1, 0, 1, 5, 1)), novel((1, 0, 1, 1)), GRAPH)


@pytest.mark.parametrize("code", [VALID, TEST, OUT])
def test_nothing_but_train_is_told(code: int) -> None:
    rows = told((1, 0, 0, 0, 1), (1, 0, 0, 3, 1))
    checks.told_from_train(FILE, rows, split(TRAIN, 0, 0, TRAIN))
    with refused(r"row 1 \(size 1, seed 0, triple 3\): expected a triple of the seed's train split"):
        checks.told_from_train(FILE, rows, split(TRAIN, 0, 0, code))
    with refused("row 0"):
        checks.told_from_train(FILE, rows.assign(seed=7), split(TRAIN, 0, 0, TRAIN))


def test_rows_about_entities_are_in_the_order_of_the_graph() -> None:
    entities = pd.DataFrame({"entity": ["a", "b"]})
    checks.rows_are_entities(FILE, entities, entities)
    with refused(r"row 0 \(entity 'b'\): expected the entities of the graph"):
        checks.rows_are_entities(FILE, entities[::-1], entities)
    with refused("expected 2 rows"):
        checks.rows_are_entities(FILE, entities[:1], entities)
