"""Splits, novel sets, insert triples and the resulting sessions, as properties of random graphs."""

from contextlib import nullcontext
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.experiment.grid import GridPoints
from isi.experiment.store import Store
from isi.graph.graph import ENTITIES, TRIPLES, Graph
from isi.graph.sessions import (
    OUT,
    SPLITS,
    TEST,
    TRAIN,
    VALID,
    SessionsOf,
    Shares,
    check_held_out,
    folds,
    later_key,
    sample_insert_triples,
    sample_novel,
    session_at,
    session_tables,
    split,
)
from tests.small_graphs import as_stored, generator, graph_of, points_of, random_graph

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


def sessions_of(points: GridPoints) -> list[tuple[np.ndarray, np.ndarray]]:
    """Entities and splits of D⁰, D¹, ... of the first model."""
    found = [points.session(number) for number in range(points.sessions + 1)]
    return [(session.entities[0].numpy(), session.splits[0].numpy()) for session in found]


@given(GRAPHS, SEEDS, st.integers(1, 2))
def test_each_session_adds_its_novel_entities_and_their_triples_to_the_one_before(
    graph: Graph, seed: int, size: int
) -> None:
    points = points_of(graph, size, [seed], steps=2)
    (d0, of0), (d1, of1), (d2, of2) = sessions_of(points)
    first, second = (set(novel.tolist()) for novel in points.novel[0])
    assert len(first | second) == 2 * size
    assert (set(np.flatnonzero(d1 & ~d0)), set(np.flatnonzero(d2 & ~d1))) == (first, second)
    assert (d0 <= d1).all()
    assert (d1 <= d2).all()
    joint = points.session(1)
    assert (d2 == joint.entities[0].numpy()).all()
    assert (of2 == joint.splits[0].numpy()).all()
    assert (of2 == points.splits[0]).all()
    np.testing.assert_array_equal(of1, np.where(touching(graph, second), OUT, of2))
    np.testing.assert_array_equal(of0, np.where(touching(graph, first | second), OUT, of2))


@pytest.mark.parametrize("heldout", [VALID, TEST])
def test_known_entities_without_a_training_triple_are_told(heldout: int) -> None:
    # 3 is tied to 0 alone, 4 to 2 by a held-out triple alone: both are orphans once 0 is novel
    graph = graph_of({(0, 0, 3): 1, (1, 0, 2): 1, (2, 0, 4): 1, (0, 0, 1): 1, (0, 0, 4): 1}, 5, 1)
    splits = torch.tensor([[TRAIN, TRAIN, heldout, TRAIN, TRAIN]], dtype=torch.int8)
    session = session_at(graph, splits, torch.tensor([[[0]]]), 0)
    assert session.entities[0].tolist() == [False, True, True, True, True]
    assert session.trained()[0].tolist() == [False, True, True, False, False]


@given(GRAPHS, SEEDS, st.integers(1, 3), st.integers(1, 2), st.sampled_from([0.3, 0.5, 1.0]))
def test_insert_triples_are_a_share_of_the_training_triples_to_ends_known_by_then(
    graph: Graph, seed: int, size: int, steps: int, fraction: float
) -> None:
    size = min(size, len(graph.entities) // steps)
    splits = split(graph, 0, seed, 0.3, 0.2)
    novel = sample_novel(np.arange(len(graph.entities)), 0, size, seed, steps)
    for session in range(1, steps + 1):
        pairs = sample_insert_triples(graph, splits, novel, session, 0, seed, fraction)
        # entities of earlier sessions are known
        unknown = set(novel[session - 1 :].ravel().tolist())
        assert len(set(pairs)) == len(pairs)
        assert {entity for entity, _ in pairs} <= set(novel[session - 1].tolist())
        for entity in novel[session - 1].tolist():
            ends = graph.triples[:, [0, 2]].numpy()
            known_end = ((ends == entity).sum(1) == 1) & ~np.isin(
                ends, list(unknown - {entity})
            ).any(1)
            usable = set(np.flatnonzero(known_end & (splits == TRAIN)).tolist())
            own = {triple for of, triple in pairs if of == entity}
            assert own <= usable
            assert len(own) == (max(1, int(fraction * len(usable))) if usable else 0)


# What draws depend on


def drawn_novel(entities: int, root: int, size: int, seed: int) -> np.ndarray:
    (novel,) = sample_novel(np.arange(entities), root, size, seed)
    return novel


def test_novel_sets_of_other_roots_differ() -> None:
    assert drawn_novel(40, 0, 5, 7).tolist() != drawn_novel(40, 1, 5, 7).tolist()


def test_novel_sets_are_drawn_uniformly_without_repeats() -> None:
    size, steps = 2, 2
    draws = np.array([sample_novel(np.arange(6), 0, size, seed, steps) for seed in range(1500)])
    assert draws.shape == (1500, steps, size)
    assert (np.diff(draws, axis=2) > 0).all()
    assert (np.diff(np.sort(draws.reshape(1500, -1)), axis=1) > 0).all()
    expected = 1500 * size / 6
    for session in range(steps):
        assert (
            np.abs(np.bincount(draws[:, session].ravel(), minlength=6) - expected).max()
            < 5 * expected**0.5
        )


def test_novel_sets_are_drawn_from_the_candidates_alone() -> None:
    candidates = np.array([3, 4, 8, 20, 21])
    drawn = [sample_novel(candidates, 0, 2, seed, 2) for seed in range(50)]
    assert set(np.concatenate(drawn).ravel()) == set(candidates.tolist())
    places = drawn_novel(5, 0, 2, 9)
    assert (sample_novel(candidates, 0, 2, 9)[0] == candidates[places]).all()


@pytest.mark.parametrize(("size", "seed"), [(1, 0), (4, 7)])
def test_a_session_that_no_other_follows_draws_from_streams_of_size_and_seed(
    size: int, seed: int
) -> None:
    graph = random_graph(12, 2, 70)
    splits, novel = split(graph, 0, seed, 0.2, 0.2), drawn_novel(12, 0, size, seed)
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
    assert sample_insert_triples(graph, splits, novel[None], 1, 0, seed, 0.5) == expected
    assert points_of(graph, size, [seed, seed + 1]).keys().tolist() == [
        [size, seed],
        [size, seed + 1],
    ]


def test_a_later_session_has_streams_of_its_own() -> None:
    graph = random_graph(12, 2, 100)
    points = points_of(graph, 1, [5], steps=2)
    assert (points.keys(*later_key(1)).tolist(), points.keys(*later_key(2)).tolist()) == (
        [[1, 5]],
        [[1, 5, 2]],
    )
    novel, entity = points.novel[0], int(points.novel[0, 1, 0])
    ends = graph.triples[:, [0, 2]].numpy()
    own = np.flatnonzero(((ends == entity).sum(1) == 1) & (points.splits[0] == TRAIN))
    chosen = np.sort(generator("insert triples", 1, 5, 2).choice(own, len(own) // 2, replace=False))
    assert len(chosen) > 1
    pairs = sample_insert_triples(graph, points.splits[0], novel, 2, 0, 5, 0.5)
    assert pairs == [(entity, triple) for triple in chosen.tolist()]


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


@pytest.mark.parametrize("steps", [1, 2])
def test_grid_points_are_read_as_they_were_drawn(steps: int) -> None:
    graph = as_stored(random_graph(13, 2, 90))
    store = store_of(graph, novel="any", sizes=[3, 1], seeds=3, steps=steps)
    grid = store.grid(2)
    assert [(points.size, points.seeds) for points in grid] == [
        (1, [0, 1]),
        (1, [2]),
        (3, [0, 1]),
        (3, [2]),
    ]
    for points in grid:
        drawn = points_of(graph, points.size, points.seeds, steps=steps)
        assert torch.equal(points.graph.triples, graph.triples)
        for name in ("novel", "splits", "insert_triples"):
            np.testing.assert_array_equal(getattr(points, name), getattr(drawn, name))
        assert set(points.insert_triples[:, 0]) == set(range(1, steps + 1))
    (only,) = store.grid(5, size=3, seeds=2)
    assert (only.size, only.seeds) == (3, [0, 1])


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
