"""Rules that the tables of one experiment must satisfy together,
tested with small hand-written tables.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isi.errors import InputError
from isi.experiment import agreement
from isi.graph.graph import Graph
from isi.graph.sessions import OUT, SPLIT_NAMES, TEST, TRAIN, VALID
from tests.small_graphs import graph_of

FILE = Path("data/a.parquet")
#: Triples 0: 0-1, 1: 1-2, 2: 2-3, 3: 3-0, 4: 0-2 of relation 0, and 5: 1-1 of relation 1.
GRAPH: Graph = graph_of(
    {(0, 0, 1): 1, (1, 0, 2): 1, (2, 0, 3): 1, (3, 0, 0): 1, (0, 0, 2): 1, (1, 1, 1): 1},
    entities=4,
    relations=2,
)


def novel(*rows: tuple[int, int, int, int]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["size", "seed", "entity", "session"], dtype=np.int64)


def given(*rows: tuple[int, int, int, int, int]) -> pd.DataFrame:
    return pd.DataFrame(
        rows, columns=["size", "seed", "entity", "triple", "session"], dtype=np.int64
    )


def split(*codes: int) -> dict[int, np.ndarray]:
    return {0: np.array(codes, dtype=np.int8)}


def refused(says: str) -> pytest.RaisesExc[InputError]:
    return pytest.raises(InputError, match=rf"^data/a\.parquet: {says}")


@pytest.mark.parametrize("missing", [TRAIN, VALID, TEST])
def test_every_seed_has_triples_in_every_split(missing: int) -> None:
    others = [code for code in (TRAIN, VALID, TEST) if code != missing]
    with refused(f"seed 0: expected at least one triple in {SPLIT_NAMES[missing]}"):
        agreement.splits_are_whole(FILE, split(*others, *[others[0]] * 4))


def test_sets_are_as_large_as_their_size_and_sizes_have_the_same_grid_points() -> None:
    whole = [(1, 0, 3, 1), (1, 0, 2, 2), (2, 0, 0, 1), (2, 0, 1, 1), (2, 0, 2, 2), (2, 0, 3, 2)]
    splits = [0, 1]
    agreement.novel_sets_are_whole(FILE, novel(*whole), splits)
    with refused("expected at least one set of novel entities"):
        agreement.novel_sets_are_whole(FILE, novel(), splits)
    with refused(r"row 4 \(size 2, seed 0, session 2\): expected the number of novel entities"):
        agreement.novel_sets_are_whole(FILE, novel(*whole[:-1]), splits)
    with refused(r"column 'seed': expected only seeds that have splits"):
        agreement.novel_sets_are_whole(FILE, novel(*whole), [1])
    for rows in (whole[:-2], whole[1:], [*whole, (2, 1, 0, 1), (2, 1, 1, 1)]):
        with refused("expected the same seeds, and the same sessions"):
            agreement.novel_sets_are_whole(FILE, novel(*rows), splits)


def test_an_insert_triple_has_an_inserted_entity_and_another_that_is_known_by_then() -> None:
    drawn = novel((1, 0, 0, 1), (1, 0, 2, 2))
    agreement.insert_triples_fit(
        FILE, given((1, 0, 0, 0, 1), (1, 0, 2, 4, 2)), drawn, split(*[TRAIN] * 6), GRAPH
    )  # entity 0 is known after session 1
    agreement.insert_triples_fit(FILE, given(), drawn, split(*[TRAIN] * 6), GRAPH)
    for row, says in (
        ((1, 0, 1, 0, 1), "expected an entity that the session inserts"),  # the entity is known
        ((1, 0, 0, 0, 2), "expected an entity that the session inserts"),  # in another session
        ((1, 1, 0, 0, 1), "expected an entity that the session inserts"),  # of another seed
        ((1, 0, 0, 1, 1), "expected the entity at one end of the triple"),
        # 2 is inserted later
        ((1, 0, 0, 4, 1), "expected the other end to be known before the session"),
    ):
        shown = f"size {row[0]}, seed {row[1]}, entity {row[2]}, triple {row[3]}"
        with refused(rf"row 0 \({shown}\): {says}"):
            agreement.insert_triples_fit(FILE, given(row), drawn, split(*[TRAIN] * 6), GRAPH)


def test_a_triple_with_the_same_entity_at_both_ends_is_no_insert_triple() -> None:
    with refused(r".*expected the entity at one end"):
        agreement.insert_triples_fit(
            FILE, given((1, 0, 1, 5, 1)), novel((1, 0, 1, 1)), split(*[TRAIN] * 6), GRAPH
        )


@pytest.mark.parametrize("code", [VALID, TEST, OUT])
def test_insert_triples_are_training_triples(code: int) -> None:
    rows, drawn = given((1, 0, 0, 0, 1), (1, 0, 0, 3, 1)), novel((1, 0, 0, 1))
    agreement.insert_triples_fit(FILE, rows, drawn, split(TRAIN, 0, 0, TRAIN, 0, 0), GRAPH)
    with refused(
        r"row 1 \(size 1, seed 0, entity 0, triple 3\): expected a triple of the seed's train split"
    ):
        agreement.insert_triples_fit(FILE, rows, drawn, split(TRAIN, 0, 0, code, 0, 0), GRAPH)
    with refused("row 0"):
        agreement.insert_triples_fit(FILE, rows, drawn, {7: np.zeros(6)}, GRAPH)
