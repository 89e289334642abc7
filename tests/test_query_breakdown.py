"""The query breakdown: each group by hand; all groups together give the measures of their scope."""

import numpy as np
import pandas as pd
import pytest
import torch

from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import evaluate, measure_rows
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.models.stack import Embedding, select
from stages.breakdown import break_down
from stages.grid import GridPoints
from stages.rank_affordances import rank_answers, ranks_of
from stages.report.tables.estimates import combined
from tests.small_graphs import ANALOGY, graph_of, points_of, random_embedding, random_graph

POINT = ["seed", "scope"]


def random_task(seeds: list[int]) -> tuple[GridPoints, Embedding, str]:
    """Arguments of ``break_down`` with a random embedding."""
    theta = select(random_embedding(3, 12, 3, 8), torch.tensor(seeds))
    return points_of(random_graph(12, 3, 90), 2, seeds), theta, "es"


def test_groups_put_together_are_the_measures_of_their_scope() -> None:
    points, theta, _ = task = random_task([0, 1, 2])
    rows = break_down(*task)
    scopes = query_sets(points.session(1), points.novel_ids, points.insert_mask)
    measured = measure_rows(evaluate(theta, scopes)).set_index(["place", "scope"])
    for measure in ("mrr_star", "mrr"):
        parts = combined(rows, POINT, measure).set_index(POINT)
        assert len(parts) == 3 * 2
        for half in ("", "_entity", "_relation"):
            found, expected = parts[f"{measure}{half}"], measured[f"{measure}{half}"]
            assert found.to_numpy() == pytest.approx(expected[found.index].to_numpy(), abs=1e-6)


def test_a_cells_groups_are_the_same_whatever_stands_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = break_down(*random_task([0, 1, 2]))
    alone = pd.concat([break_down(*random_task([seed])) for seed in (0, 1, 2)])
    monkeypatch.setattr("isi.evaluation.ranks.BUDGET", 2 * 3 * 12 * 3)  # three queries at a time
    pieces = break_down(*random_task([0, 1, 2]))
    for other, exact in ((alone, True), (pieces, False)):
        one, two = (
            rows.sort_values("seed", kind="stable").reset_index(drop=True)
            for rows in (together, other)
        )
        pd.testing.assert_frame_equal(one, two, check_exact=exact)


#: f(h, r, t) = h · t, and half of it for relation 1. Entity 3 is novel, with one insert triple
#: (3, 0, 0).
GRAPH = graph_of(
    {(0, 0, 1): 2, (2, 0, 1): 1, (3, 0, 0): 4, (3, 0, 1): 2, (0, 1, 4): 5, (4, 1, 3): 2}, 5, 2
)
SPLITS = np.array([[TRAIN, VALID, TRAIN, TRAIN, TRAIN, TEST]], dtype=np.int8)


def test_groups_by_hand() -> None:
    points = GridPoints("home", GRAPH, 1, [7], SPLITS, np.array([[3]]), np.array([[0, 0, 2]]))
    entity = torch.zeros(1, 5, 4)
    entity[0, :, 0] = torch.arange(1.0, 6.0)
    relation = torch.tensor([[[1.0, 0, 0, 0], [0.5, 0, 0, 0]]])
    rows = break_down(points, Embedding(entity, relation, ANALOGY), "joint")
    assert set(rows["model"]) == {"joint"}
    assert set(rows["seed"]) == {7}
    groups = rows[rows["scope"] == "novel"].set_index(["relation", "hidden", "novel"])
    values = groups[["queries", "mrr", "mrr_star", "observations"]].round(6).to_numpy()
    # (3, 0, 1) is observed twice, (4, 1, 3) is a test triple
    assert dict(zip(groups.index, map(tuple, values.tolist()), strict=True)) == {
        # (?, 0, 1): 4 is ahead; 0 and 2 are true
        ("relation 0", "head", "answer"): (2, 0.5, 0.5, 9),
        # (3, 0, ?): 4, 3 and 2 are ahead; 0 is seen more often, so that R_G is 2
        ("relation 0", "tail", "given"): (2, 0.25, 0.333333, 9),
        # (?, 1, 3): none is ahead; (4, 1, ?): 4 is
        ("relation 1", "head", "given"): (1, 1, 1, 7),
        ("relation 1", "tail", "answer"): (1, 0.5, 0.5, 7),
        # relation 0 scores higher
        ("relation 0", "relation", "given"): (2, 1, 1, 9),
        ("relation 1", "relation", "given"): (1, 0.5, 0.5, 7),
    }


def test_both_ends_are_novel() -> None:
    points = GridPoints("home", GRAPH, 2, [7], SPLITS, np.array([[3, 4]]))
    rows = break_down(points, random_embedding(1, 5, 2, 4), "joint")
    own = rows[rows["scope"] == "novel"].set_index(["relation", "hidden", "novel"])["queries"]
    in_1 = own["relation 1"]
    # (4, 1, 3), and (0, 1, 4), which is observed 5 times
    assert in_1["head"].to_dict() == {"both": 1, "given": 5}
    assert in_1["tail"].to_dict() == {"both": 1, "answer": 5}
    assert in_1["relation"].to_dict() == {"given": 6}


# Affordances

#: Entities 0 to 3 are known; 5 is inserted; 4 and 6 take no part.
SMALL_GRAPH = graph_of(
    {
        (0, 0, 1): 3,
        (1, 0, 2): 1,
        (2, 1, 3): 2,
        (4, 0, 1): 7,
        (5, 0, 1): 6,
        (5, 0, 2): 8,
        (6, 0, 2): 9,
    },
    7,
    2,
)
SMALL_SPLITS = np.array([[TRAIN, TRAIN, TRAIN, OUT, TRAIN, TEST, OUT]], dtype=np.int8)
INSERTED = GridPoints("home", SMALL_GRAPH, 1, [3], SMALL_SPLITS, np.array([[5]]))


def test_candidates_outside_the_session_neither_rank_nor_answer() -> None:
    scores = torch.tensor([[[0.5, 0.9, 0.1, 0.5, 9.0, 0.7, 8.0]]])
    assert ranks_of(scores, INSERTED.session(1).entities[:, None]).tolist() == [
        [[3, 1, 5, 4, 0, 2, 0]]
    ]


def test_ranks_follow_the_scores_of_each_answer_one_by_one() -> None:
    theta0 = random_embedding(1, 7, 2, 8)
    vectors = random_embedding(1, 1, 1, 8, seed=5).entity
    table = theta0.entity[0].clone()
    table[5] = vectors[0, 0]
    candidates = [0, 1, 2, 3, 5]
    score = {
        e: float(theta0.model.score(table[5], theta0.relation[0, 1], table[e])) for e in candidates
    }
    expected = {e: 1 + sum(score[other] > score[e] for other in candidates) for e in candidates}
    found = rank_answers(INSERTED, theta0, "es", vectors.numpy(), relation=1)
    assert dict(zip(found["answer"], found["rank"], strict=True)) == expected
    assert set(found["seed"]) == {3}
    assert set(found["entity"]) == {5}


def rows_of(*groups: tuple[str, str, int, float, int]) -> pd.DataFrame:
    """Groups of one grid point: relation, hidden, queries, MRR, observations."""
    columns = ["relation", "hidden", "queries", "mrr", "observations"]
    return pd.DataFrame(groups, columns=columns).assign(model="es", size=1, seed=0)


def test_parts_weigh_queries_and_observations_and_a_half_without_queries_is_null() -> None:
    rows = rows_of(
        ("on", "head", 2, 0.2, 3),
        ("on", "tail", 1, 0.8, 3),
        ("in", "tail", 5, 0.9, 1),
        ("on", "relation", 1, 0.5, 3),
        ("in", "relation", 3, 0.8, 1),
    )
    (found,) = combined(rows, ["model", "size", "seed"]).to_dict("records")
    assert found["mrr_entity"] == pytest.approx((3 * 0.4 + 0.9) / 4)
    assert found["mrr_relation"] == pytest.approx((0.5 + 3 * 0.8) / 4)
    assert found["mrr"] == pytest.approx((0.525 + 0.725) / 2)
    # a group of another role of the novel entity
    split = pd.concat([rows, rows_of(("on", "head", 4, 0.8, 3))])
    assert combined(split, ["seed"])["mrr_entity"].tolist() == pytest.approx(
        [(3 * (4.4 / 7) + 0.9) / 4]
    )
    by_relation = combined(rows, ["seed", "relation"]).set_index("relation")["mrr_entity"]
    assert by_relation.to_dict() == pytest.approx({"on": 0.4, "in": 0.9})
    rows = rows_of(("on", "head", 2, 0.25, 3), ("on", "relation", 2, 0.75, 3))
    (entities,) = combined(rows[rows["hidden"] == "head"], ["seed"]).to_dict("records")
    (relations,) = combined(rows[rows["hidden"] == "relation"], ["seed"]).to_dict("records")
    assert entities["mrr_entity"] == 0.25
    assert relations["mrr_relation"] == 0.75
    assert np.isnan([entities["mrr"], entities["mrr_relation"], relations["mrr"]]).all()
