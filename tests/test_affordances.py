"""Ranks of what can be done with inserted entities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from isi.analyses.query_breakdown import rank_answers, ranks_of
from isi.experiment.grid import GridPoints
from isi.graph.sessions import OUT, TEST, TRAIN
from tests.small_graphs import graph_of, random_embedding

#: Entities 0 to 3 are known; 5 is inserted, and 6 in a later session, if at all; 4 takes no part.
GRAPH = graph_of(
    {(0, 0, 1): 3, (1, 0, 2): 1, (2, 1, 3): 2, (4, 0, 1): 7, (5, 0, 1): 6, (5, 0, 2): 8, (6, 0, 2): 9}, 7, 2
)
SPLITS = np.array([[TRAIN, TRAIN, TRAIN, OUT, TRAIN, TEST, OUT]], dtype=np.int8)
POINTS = GridPoints("home", GRAPH, 1, [3], SPLITS, np.array([[[5]]]))
LATER = replace(POINTS, splits=np.where(np.arange(7) == 6, TRAIN, SPLITS), novel=np.array([[[5], [6]]]))


def test_candidates_outside_the_session_neither_rank_nor_answer() -> None:
    scores = torch.tensor([[[0.5, 0.9, 0.1, 0.5, 9.0, 0.7, 8.0]]])
    assert ranks_of(scores, POINTS.session(1).entities[:, None]).tolist() == [[[3, 1, 5, 4, 0, 2, 0]]]


def test_ranks_follow_the_scores_of_each_answer_one_by_one() -> None:
    theta0 = random_embedding(1, 7, 2, 8)
    vectors = random_embedding(1, 1, 1, 8, seed=5).entity
    table = theta0.entity[0].clone()
    table[5] = vectors[0, 0]
    candidates = [0, 1, 2, 3, 5]
    score = {e: float(theta0.model.score(table[5], theta0.relation[0, 1], table[e])) for e in candidates}
    expected = {e: 1 + sum(score[other] > score[e] for other in candidates) for e in candidates}
    for points in (POINTS, LATER):  # ranked after the first session, whoever comes later
        found = rank_answers(points, theta0, "es", vectors.numpy(), relation=1)
        assert dict(zip(found["answer"], found["rank"], strict=True)) == expected
        assert set(found["seed"]) == {3}
        assert set(found["entity"]) == {5}
