"""Splits, novel sets and insert triples as properties of random graphs."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.graph import Graph
from isi.sessions import (
    OUT,
    TEST,
    TRAIN,
    VALID,
    check_held_out,
    draw_insert_triples,
    draw_novel,
    folds,
    initial_session,
    joint_session,
    split,
)
from isi.streams import stream
from tests.graphs import cells_of, graph_of, random_graph

GRAPHS = st.builds(random_graph, st.integers(4, 9), st.integers(1, 3), st.integers(9, 40), seed=st.integers(0, 10_000))
SEEDS = st.integers(0, 10_000)


@given(GRAPHS, SEEDS, st.floats(0.05, 0.6), st.floats(0.05, 0.6))
def test_every_entity_and_relation_is_in_train(graph: Graph, seed: int, valid: float, test: float) -> None:
    splits = split(graph, 0, seed, valid, test)
    train = graph.triples.numpy()[splits == TRAIN]
    assert set(train[:, [0, 2]].ravel()) == set(range(len(graph.entities)))
    assert set(train[:, 1]) == set(range(len(graph.relations)))


@given(GRAPHS, SEEDS)
def test_splits_are_disjoint_and_cover(graph: Graph, seed: int) -> None:
    session = joint_session(graph, torch.from_numpy(split(graph, 0, seed, 0.2, 0.3))[None])
    members = torch.stack([session.members(part)[0] for part in (TRAIN, VALID, TEST)])
    assert (members.sum(0) == 1).all()
    assert torch.equal(session.members(TRAIN, VALID)[0], members[0] | members[1])


@given(SEEDS, st.integers(0, 20), st.integers(0, 20))
def test_shares_are_as_asked(seed: int, valid: int, test: int) -> None:
    graph = random_graph(5, 2, 50)  # at least 43 triples are free to leave train
    splits = split(graph, 0, seed, valid / 50, test / 50)
    assert [int((splits == part).sum()) for part in (TRAIN, VALID, TEST)] == [50 - valid - test, valid, test]


@pytest.mark.parametrize(
    ("valids", "tests", "enough"), [(10, 20, True), (9, 20, False), (10, 19, False), (11, 21, True)]
)
def test_a_split_that_holds_out_less_than_asked_is_refused(valids: int, tests: int, enough: bool) -> None:
    splits = np.array([VALID] * valids + [TEST] * tests + [TRAIN] * (100 - valids - tests), dtype=np.int8)
    good = np.array([VALID] * 10 + [TEST] * 20 + [TRAIN] * 70, dtype=np.int8)
    with nullcontext() if enough else pytest.raises(InputError, match=r"sessions\.valid, sessions\.test"):
        check_held_out([good, splits], 0.1, 0.2)


def test_a_split_that_holds_out_nothing_is_refused_however_little_was_asked() -> None:
    with pytest.raises(InputError, match=r"sessions\.valid, sessions\.test"):
        check_held_out([np.array([TRAIN] * 9 + [TEST], dtype=np.int8)], 0.01, 0.1)


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


@given(GRAPHS, SEEDS, st.integers(1, 3))
def test_d0_has_no_novel_entity_and_none_of_its_triples(graph: Graph, seed: int, size: int) -> None:
    splits, novel = split(graph, 0, seed, 0.2, 0.2), draw_novel(len(graph.entities), 0, size, seed)
    session = initial_session(graph, torch.from_numpy(splits)[None], torch.from_numpy(novel)[None])
    assert set(np.flatnonzero(~session.entities[0].numpy())) == set(novel.tolist())
    for (head, _, tail), before, now in zip(graph.triples.tolist(), splits, session.splits[0], strict=True):
        assert now == (OUT if {head, tail} & set(novel.tolist()) else before)


@pytest.mark.parametrize("heldout", [VALID, TEST])
def test_known_entities_without_a_training_triple_are_told(heldout: int) -> None:
    # 3 is tied to 0 alone, 4 to 2 by a held-out triple alone: both are orphans once 0 is novel
    graph = graph_of({(0, 0, 3): 1, (1, 0, 2): 1, (2, 0, 4): 1, (0, 0, 1): 1, (0, 0, 4): 1}, 5, 1)
    splits = torch.tensor([[TRAIN, TRAIN, heldout, TRAIN, TRAIN]], dtype=torch.int8)
    session = initial_session(graph, splits, torch.tensor([[0]]))
    assert session.entities[0].tolist() == [False, True, True, True, True]
    assert session.trained()[0].tolist() == [False, True, True, False, False]


@given(GRAPHS, SEEDS, st.integers(1, 3), st.sampled_from([0.3, 0.5, 1.0]))
def test_insert_triples_are_a_share_of_the_training_triples_to_known_ends(
    graph: Graph, seed: int, size: int, fraction: float
) -> None:
    splits, novel = split(graph, 0, seed, 0.3, 0.2), draw_novel(len(graph.entities), 0, size, seed)
    pairs = draw_insert_triples(graph, splits, novel, 0, seed, fraction)
    assert len(set(pairs)) == len(pairs)
    assert {entity for entity, _ in pairs} <= set(novel.tolist())
    triples = graph.triples.tolist()
    for entity in novel.tolist():
        usable = set()
        for number, (head, _, tail) in enumerate(triples):
            others = [end for end in (head, tail) if end != entity]
            if splits[number] == TRAIN and len(others) == 1 and others[0] not in novel.tolist():
                usable.add(number)
        own = {triple for of, triple in pairs if of == entity}
        assert own <= usable
        assert len(own) == (max(1, int(fraction * len(usable))) if usable else 0)


def test_a_novel_entity_tied_only_to_novel_ones_has_no_insert_triple() -> None:
    graph = graph_of({(0, 0, 1): 3, (0, 0, 0): 1, (1, 0, 2): 1}, 3, 1)
    pairs = draw_insert_triples(graph, np.zeros(3, dtype=np.int8), np.array([0, 1]), 0, 0, 0.5)
    assert pairs == [(1, 2)]


def test_novel_sets_depend_on_root_size_and_seed_alone() -> None:
    first = draw_novel(40, 0, 5, 7)
    stream(0, "novel", 5, 8).random(100)
    cells = [cells_of(random_graph(40, 2, 60, seed=which), 5, [3, 7]) for which in (0, 1)]
    assert (first == draw_novel(40, 0, 5, 7)).all()
    assert all((first == of.novel[1]).all() for of in cells)
    others = [draw_novel(40, *key).tolist() for key in ((1, 5, 7), (0, 5, 8), (0, 5, 9))]
    assert first.tolist() not in others
    assert draw_novel(40, 0, 4, 7).tolist() != first[:4].tolist()


@pytest.mark.parametrize("size", [1, 3])
def test_novel_sets_are_drawn_uniformly_without_repeats(size: int) -> None:
    draws = np.array([draw_novel(6, 0, size, seed) for seed in range(1500)])
    assert (np.diff(draws, axis=1) > 0).all()
    expected = 1500 * size / 6
    assert np.abs(np.bincount(draws.ravel(), minlength=6) - expected).max() < 5 * expected**0.5


def test_streams_with_different_keys_differ() -> None:
    keys = [(0, "batches", 1, 2), (1, "batches", 1, 2), (0, "splits", 1, 2), (0, "batches", 2, 1), (0, "batches", 1, 3)]
    assert len({stream(*key).random() for key in keys}) == len(keys)
