"""Splits, novel sets, insert triples and the resulting sessions, as properties of random graphs."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.evaluation.changes import changed_query_sets
from isi.evaluation.query_sets import query_sets
from isi.graph.graph import Graph, MinedSource, build_graph, build_tables
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, folds, session_at, split
from isi.tables import paths
from stages.files import ENTITIES, SPLIT_NAMES, SPLITS, TRIPLES
from stages.make_sessions import (
    PUBLISHED_FOLDS,
    SessionsOf,
    Shares,
    check_held_out,
    published_split,
    sample_insert_triples,
    sample_novel,
    session_tables,
)
from stages.store import Store
from tests.observing import observations_of
from tests.small_graphs import InsertFrom, as_stored, generator, graph_of, points_of, random_graph

GRAPHS = st.builds(
    random_graph,
    st.integers(4, 9),
    st.integers(1, 3),
    st.integers(9, 40),
    seed=st.integers(0, 10_000),
)
SEEDS = st.integers(0, 10_000)


@given(GRAPHS, SEEDS, st.floats(0.05, 0.6), st.floats(0.05, 0.6))
def test_every_entity_and_relation_is_in_train(
    graph: Graph, seed: int, valid: float, test: float
) -> None:
    splits = split(graph, 0, seed, valid, test)
    train = graph.triples.numpy()[splits == TRAIN]
    assert set(train[:, [0, 2]].ravel()) == set(range(len(graph.entities)))
    assert set(train[:, 1]) == set(range(len(graph.relations)))


@given(SEEDS, st.integers(0, 20), st.integers(0, 20))
def test_shares_are_as_asked(seed: int, valid: int, test: int) -> None:
    graph = random_graph(5, 2, 50)  # at least 43 triples are free to leave train
    splits = split(graph, 0, seed, valid / 50, test / 50)
    assert [int((splits == part).sum()) for part in (TRAIN, VALID, TEST)] == [
        50 - valid - test,
        valid,
        test,
    ]


@pytest.mark.parametrize(
    ("valids", "tests", "enough"),
    [(10, 20, True), (9, 20, False), (10, 19, False), (11, 21, True), (0, 20, False)],
)
def test_a_split_that_holds_out_less_than_asked_is_refused(
    valids: int, tests: int, enough: bool
) -> None:
    splits = np.array(
        [VALID] * valids + [TEST] * tests + [TRAIN] * (100 - valids - tests), dtype=np.int8
    )
    with (
        nullcontext()
        if enough
        else pytest.raises(InputError, match=r"sessions\.valid, sessions\.test")
    ):
        check_held_out(splits, 0.1, 0.2)


@given(GRAPHS, SEEDS, st.integers(2, 7))
def test_folds_leave_every_entity_and_relation_in_train_and_part_the_rest_evenly(
    graph: Graph, root: int, number: int
) -> None:
    splits = folds(graph, root, number)
    held_out = splits == VALID
    assert splits.shape == (number, len(graph.triples))
    assert (held_out | (splits == TRAIN)).all()
    assert held_out.sum(0).max() <= 1
    sizes = held_out.sum(1)
    assert sizes.max() - sizes.min() <= 1
    always = graph.triples.numpy()[~held_out.any(0)]
    assert set(always[:, [0, 2]].ravel()) == set(range(len(graph.entities)))
    assert set(always[:, 1]) == set(range(len(graph.relations)))
    assert len(always) <= len(graph.entities) + len(graph.relations)  # no more than it takes


def test_splits_differ_between_seeds_and_roots() -> None:
    graph = random_graph(5, 2, 50)
    drawn = {split(graph, root, seed, 0.2, 0.2).tobytes() for root in range(3) for seed in range(3)}
    assert len(drawn) == 9
    assert (split(graph, 1, 2, 0.2, 0.2) == split(graph, 1, 2, 0.2, 0.2)).all()


def touching(graph: Graph, entities: set[int]) -> np.ndarray:
    """A mask of the triples with one of these entities at an end."""
    return np.isin(graph.triples[:, [0, 2]], list(entities)).any(1)


@given(GRAPHS, SEEDS, st.integers(1, 3))
def test_the_session_adds_the_novel_entities_and_their_triples(
    graph: Graph, seed: int, size: int
) -> None:
    points = points_of(graph, size, [seed])
    before, after = points.session(0), points.session(1)
    novel = set(points.novel[0].tolist())
    assert set(np.flatnonzero(after.entities[0] & ~before.entities[0])) == novel
    assert after.entities.all()
    assert (after.splits[0].numpy() == points.splits[0]).all()
    expected = np.where(touching(graph, novel), OUT, points.splits[0])
    np.testing.assert_array_equal(before.splits[0], expected)


@pytest.mark.parametrize("heldout", [VALID, TEST])
def test_known_entities_without_a_training_triple_are_told(heldout: int) -> None:
    # 3 is tied to 0 alone, 4 to 2 by a held-out triple alone: both are orphans once 0 is novel
    graph = graph_of({(0, 0, 3): 1, (1, 0, 2): 1, (2, 0, 4): 1, (0, 0, 1): 1, (0, 0, 4): 1}, 5, 1)
    splits = torch.tensor([[TRAIN, TRAIN, heldout, TRAIN, TRAIN]], dtype=torch.int8)
    session = session_at(graph, splits, torch.tensor([[0]]), 0)
    assert session.entities[0].tolist() == [False, True, True, True, True]
    assert session.trained()[0].tolist() == [False, True, True, False, False]


@given(
    GRAPHS,
    SEEDS,
    st.integers(1, 3),
    st.sampled_from([0.3, 0.5, 1.0]),
    st.sampled_from(["train", "all"]),
)
def test_insert_triples_are_a_share_of_the_triples_to_known_ends_of_training_or_of_all_splits(
    graph: Graph, seed: int, size: int, fraction: float, insert_from: InsertFrom
) -> None:
    splits = split(graph, 0, seed, 0.3, 0.2)
    novel = sample_novel(np.arange(len(graph.entities)), 0, size, seed)
    pairs = sample_insert_triples(graph, splits, novel, 0, seed, fraction, insert_from)
    assert len(set(pairs)) == len(pairs)
    assert {entity for entity, _ in pairs} <= set(novel.tolist())
    ends = graph.triples[:, [0, 2]].numpy()
    known_end = np.isin(ends, novel).sum(1) == 1
    drawn_from = (splits == TRAIN) | (insert_from == "all")
    for entity in novel.tolist():
        usable = set(np.flatnonzero(touching(graph, {entity}) & known_end & drawn_from).tolist())
        own = {triple for of, triple in pairs if of == entity}
        assert own <= usable
        assert len(own) == (max(1, int(fraction * len(usable))) if usable else 0)


def test_insert_triples_from_all_splits_are_of_all_and_no_query_asks_for_them() -> None:
    points = points_of(random_graph(13, 2, 90), 3, [0, 1, 2], insert_from="all")
    drawn = points.splits[points.insert_triples[:, 0], points.insert_triples[:, 2]]
    assert set(drawn.tolist()) == {TRAIN, VALID, TEST}
    given = points.session(1), points.novel_ids, points.insert_mask
    for queries in (query_sets(*given) | changed_query_sets(*given)).values():
        assert not (queries.queried > 0)[points.insert_mask].any()


# What draws depend on


def test_novel_sets_of_other_roots_differ() -> None:
    one, other = (sample_novel(np.arange(40), root, 5, 7).tolist() for root in (0, 1))
    assert one != other


def test_novel_sets_are_drawn_uniformly_without_repeats() -> None:
    size = 3
    draws = np.array([sample_novel(np.arange(6), 0, size, seed) for seed in range(1500)])
    assert draws.shape == (1500, size)
    assert (np.diff(draws, axis=1) > 0).all()
    expected = 1500 * size / 6
    counts = np.bincount(draws.ravel(), minlength=6)
    assert np.abs(counts - expected).max() < 5 * expected**0.5


def test_novel_sets_are_drawn_from_the_candidates_alone() -> None:
    candidates = np.array([3, 4, 8, 20, 21])
    drawn = [sample_novel(candidates, 0, 2, seed) for seed in range(50)]
    assert set(np.concatenate(drawn)) == set(candidates.tolist())
    places = sample_novel(np.arange(5), 0, 2, 9)
    assert (sample_novel(candidates, 0, 2, 9) == candidates[places]).all()


@pytest.mark.parametrize(("size", "seed"), [(1, 0), (4, 7)])
def test_draws_are_of_streams_of_size_and_seed(size: int, seed: int) -> None:
    graph = random_graph(12, 2, 70)
    splits, novel = split(graph, 0, seed, 0.2, 0.2), sample_novel(np.arange(12), 0, size, seed)
    assert novel.tolist() == sorted(
        generator("novel", size, seed).choice(12, size, replace=False).tolist()
    )
    rng, expected = generator("insert triples", size, seed), []
    for entity in novel.tolist():
        alone = touching(graph, {entity}) & (np.isin(graph.triples[:, [0, 2]], novel).sum(1) == 1)
        own = np.flatnonzero(alone & (splits == TRAIN))
        chosen = (
            sorted(rng.choice(own, max(1, len(own) // 2), replace=False).tolist())
            if len(own)
            else []
        )
        expected += [(entity, triple) for triple in chosen]
    assert sample_insert_triples(graph, splits, novel, 0, seed, 0.5) == expected
    assert points_of(graph, size, [seed, seed + 1]).keys().tolist() == [
        [size, seed],
        [size, seed + 1],
    ]


def test_a_part_of_a_graph_keeps_the_ids_of_entities() -> None:
    graph = graph_of({(0, 0, 1): 3, (1, 0, 2): 1, (2, 1, 3): 2, (4, 0, 1): 7}, 5, 2)
    part = graph.part(np.array([1, 3]))
    assert (part.triples.tolist(), part.counts.tolist()) == ([[1, 0, 2], [4, 0, 1]], [1, 7])
    assert part.entities == graph.entities


# Tables

SHARES = Shares(valid=0.2, test=0.2, insert_fraction=0.5)


def store_of(graph: Graph, **sessions: Any) -> Store:
    """A store in memory of a graph and the sessions sampled for it."""
    names = np.array(graph.entities)
    entities = pd.DataFrame({"entity": names, "phrase": names, "kind": "object", "source": "here"})
    head, relation, tail = graph.triples.numpy().T
    triples = pd.DataFrame(
        {"head": names[head], "relation": np.array(graph.relations)[relation], "tail": names[tail]}
    )
    triples = triples.assign(count=graph.counts.numpy().astype(np.int32), source="here")
    drawn = session_tables(
        graph, entities, SessionsOf(**sessions), SHARES, 0, "experiments.home.sessions"
    )
    ordered = {table: frame.sort_values(list(table.key)) for table, frame in drawn.items()}
    return Store("home", {ENTITIES: entities, TRIPLES: triples, **ordered})


@pytest.mark.parametrize("insert_from", ["train", "all"])
def test_grid_points_are_read_as_they_were_drawn(insert_from: InsertFrom) -> None:
    graph = as_stored(random_graph(13, 2, 90))
    store = store_of(graph, novel="any", sizes=[3, 1], seeds=3, insert_from=insert_from)
    grid = store.grid(2)
    assert [(points.size, points.seeds) for points in grid] == [
        (1, [0, 1]),
        (1, [2]),
        (3, [0, 1]),
        (3, [2]),
    ]
    for points in grid:
        drawn = points_of(graph, points.size, points.seeds, insert_from)
        assert torch.equal(points.graph.triples, graph.triples)
        for name in ("novel", "splits", "insert_triples"):
            np.testing.assert_array_equal(getattr(points, name), getattr(drawn, name))
    (only,) = store.grid(5, size=3, seeds=2)
    assert (only.size, only.seeds) == (3, [0, 1])
    assert not store.shares_split


def test_triples_without_a_row_have_no_split() -> None:
    names = [("a", "on", "b"), ("b", "of", "a"), ("b", "on", "a")]
    triples = pd.DataFrame(names, columns=["head", "relation", "tail"]).assign(
        count=1, source="here"
    )
    rows = [(0, 0, "train"), (0, 1, "valid"), (1, 0, "train"), (1, 2, "test")]
    splits = pd.DataFrame(rows, columns=["seed", "triple", "split"])
    read = Store("home", {TRIPLES: triples, SPLITS: splits}).splits()
    assert {seed: codes.tolist() for seed, codes in read.items()} == {
        0: [0, 1, OUT],
        1: [0, OUT, 2],
    }


# The published split

NAMES = ["head", "relation", "tail"]


@pytest.fixture(scope="module")
def published() -> Graph:
    observed = observations_of({"reader": "published"})
    tables = build_tables(MinedSource("published", observed.table, observed.kinds))
    return build_graph(tables.entities, tables.triples)


def test_a_published_fold_is_that_of_the_papers_authors(published: Graph) -> None:
    names = pd.read_csv(paths.PUBLISHED_PHRASES).set_index("synset")["entity"]
    folds = pd.read_csv(PUBLISHED_FOLDS).replace({"head": names, "tail": names})
    expected = folds.set_index(NAMES)
    for fold in (0, 3):
        codes = published_split(published, fold, 0, 7, 0.1, 0.1)
        assert np.bincount(codes).tolist() == [282, 35, 35]
        for (head, relation, tail), code in zip(published.triples.tolist(), codes, strict=True):
            ends = published.entities[head], published.relations[relation], published.entities[tail]
            assert SPLIT_NAMES[code] == expected.loc[ends, f"fold_{fold}"]
    store = store_of(
        published, novel="any", sizes=[1], seeds=2, split={"from": "published", "fold": 0}
    )
    assert store.shares_split


def test_triples_of_another_source_are_split_for_each_seed_with_all_their_entities_in_train(
    published: Graph,
) -> None:
    new = [(101 + n % 7, n % 3, n % 11) for n in range(60)]
    triples = torch.cat([published.triples, torch.tensor(new)])
    extended = replace(
        published,
        entities=[*published.entities, *(f"new {n}" for n in range(7))],
        triples=triples,
        counts=torch.ones(len(triples), dtype=torch.int64),
    )
    alone = published_split(published, 1, 0, 0, 0.1, 0.1)
    one, other = (published_split(extended, 1, 0, seed, 0.1, 0.1) for seed in (0, 1))
    assert (one[:352] == alone).all()
    assert (other[:352] == alone).all()
    assert (one != other).any()
    assert np.bincount(one[352:]).tolist() == [48, 6, 6]
    train = triples[352:].numpy()[one[352:] == TRAIN]
    assert set(train[:, [0, 2]].ravel()) == set(triples[352:, [0, 2]].flatten().tolist())


def test_a_published_split_of_another_graph_is_refused() -> None:
    with pytest.raises(InputError, match=r"params\.yaml: sessions\.split: expected "):
        published_split(random_graph(5, 2, 20), 0, 0, 0, 0.1, 0.1)
