"""The transfer: sessions over a part of a graph, and ranks of affordances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from isi import paths, sessions, tables
from isi.embeddings import analogy
from isi.experiments.affordances import RankingTask, ranks, ranks_of
from isi.experiments.cells import Cells
from isi.experiments.store import Store
from isi.graph import Graph
from isi.sessions import OUT, TEST, TRAIN, joint_session
from isi.tables import HAS_AFFORDANCE, Provenance
from tests.graphs import graph_of, random_embedding

#: Entities 0 to 3 are known; 4, 5 and 6 are candidates, of which 5 is drawn.
COUNTS = {(0, 0, 1): 3, (1, 0, 2): 1, (2, 1, 3): 2, (4, 0, 1): 7, (5, 0, 1): 6, (5, 0, 2): 8, (6, 0, 2): 9}
GRAPH = graph_of(COUNTS, 7, 2)


def cells() -> Cells:
    splits = np.array([[TRAIN, TRAIN, TRAIN, OUT, TRAIN, TEST, OUT]], dtype=np.int8)
    return Cells(GRAPH, 1, [3], splits, np.array([[5]]))


def test_entities_of_triples_without_a_split_take_no_part() -> None:
    assert cells().joint.entities.tolist() == [[True, True, True, True, False, True, False]]
    assert cells().initial.entities.tolist() == [[True, True, True, True, False, False, False]]


def test_without_leaves_every_triple_that_touches_none_of_the_entities() -> None:
    assert sessions.without(GRAPH, np.array([4, 6])).tolist() == [0, 1, 2, 4, 5]
    assert sessions.without(GRAPH, np.array([], dtype=int)).tolist() == list(range(7))


def test_a_part_of_a_graph_keeps_the_ids_of_entities() -> None:
    part = GRAPH.part(np.array([1, 4]))
    assert (part.triples.tolist(), part.counts.tolist()) == ([[1, 0, 2], [5, 0, 1]], [1, 6])
    assert part.entities == GRAPH.entities


def test_triples_without_a_row_have_no_split(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    where = Provenance("test", {})
    names = [("a", "atLocation", "b"), ("b", "atLocation", "a"), ("b", "hasMaterial", "a")]
    triples = pd.DataFrame(names, columns=["head", "relation", "tail"]).assign(count=1, source="ai2thor")
    tables.write(paths.triples("transfer"), triples, tables.TRIPLES, where)
    rows = [(1, 2, "test"), (0, 0, "train"), (1, 0, "train"), (0, 1, "valid")]
    splits = pd.DataFrame(rows, columns=["seed", "triple", "split"])
    tables.write(paths.splits("transfer"), splits, tables.SPLITS, where)
    read = Store("transfer", where).splits()
    assert {seed: codes.tolist() for seed, codes in read.items()} == {0: [0, 1, OUT], 1: [0, OUT, 2]}


def test_candidates_outside_the_session_neither_rank_nor_answer() -> None:
    session = joint_session(GRAPH, torch.as_tensor(cells().splits))
    scores = torch.tensor([[[0.5, 0.9, 0.1, 0.5, 9.0, 0.7, 8.0]]])
    assert ranks_of(scores, session.entities[:, None]).tolist() == [[[3, 1, 5, 4, 0, 2, 0]]]


def test_ranks_follow_the_scores_of_each_answer_one_by_one() -> None:
    graph = Graph(GRAPH.entities, ["atLocation", HAS_AFFORDANCE], GRAPH.triples, GRAPH.counts)
    theta0 = random_embedding(1, 7, 2, 8)
    vectors = random_embedding(1, 1, 1, 8, seed=5).entity
    before = (theta0.entity.numpy(), theta0.relation.numpy())
    found = ranks(RankingTask(graph, 1, [3], cells().splits, cells().novel, before, vectors.numpy()))
    table = theta0.entity[0].clone()
    table[5] = vectors[0, 0]
    candidates = [0, 1, 2, 3, 5]
    score = {e: float(analogy.score(table[5], theta0.relation[0, 1], table[e])) for e in candidates}
    expected = {e: 1 + sum(score[other] > score[e] for other in candidates) for e in candidates}
    assert dict(zip(found["answer"], found["rank"], strict=True)) == expected
    assert set(found["seed"]) == {3}
    assert set(found["entity"]) == {5}
