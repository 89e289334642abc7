"""Single insertions: the indicators of a centre, positions on the map, and the order of answers."""

import numpy as np
import pandas as pd
import pytest
import torch

from isi.analyses.single_insertions import (
    SHOWN,
    TABLES,
    Plane,
    ShownEntities,
    first_answers,
    procrustes,
    queries_of,
    single_insertions,
)
from isi.experiment.grid import GridPoints
from isi.experiment.insert import insert_stack
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, graph_of
from tests.small_grid import ENTITIES, EXPLORER, WORDS, explorer_task, insert_tasks, stacks, theta0

(POINTS,), TRAINED = stacks(4), theta0()
SEEDS_OF = explorer_task()[5]


@pytest.fixture(scope="module")
def tables() -> dict[str, pd.DataFrame]:
    return single_insertions(*explorer_task())


# Places


def test_a_plane_holds_the_two_axes_of_most_variance() -> None:
    vectors = torch.tensor([[3.0, 0, 1, 0], [-3, 0, 1, 0], [0, -2, 1, 0], [0, 2, 1, 0], [0, 0, 2, 0], [0, 0, 0, 0]])
    tables = Plane.of(vectors)
    assert tables.share == pytest.approx((18 + 8) / (18 + 8 + 2))
    places = tables.project(torch.tensor([[3.0, 0, 1, 5], [0, 2, 1, 0]]))
    assert places.numpy() == pytest.approx(np.array([[3, 0], [0, 2]]), abs=1e-12)


def test_what_is_turned_scaled_and_moved_comes_back() -> None:
    rng = np.random.default_rng(1)
    onto = torch.as_tensor(rng.normal(size=(2, 9, 4)))
    rotation = torch.as_tensor(np.linalg.qr(rng.normal(size=(4, 4)))[0])
    known = torch.tensor([[True] * 6 + [False] * 3] * 2)
    turned, fitted = procrustes(0.3 * onto @ rotation + 7, onto, known)
    assert turned.numpy() == pytest.approx(onto.numpy(), abs=1e-9)
    assert fitted.tolist() == pytest.approx([1, 1])
    noisy = onto + torch.as_tensor(rng.normal(size=onto.shape))
    turned, fitted = procrustes(noisy, onto, known)
    for one, other, share in zip(turned[:, :6], onto[:, :6], fitted.tolist(), strict=True):
        left = (one - other).square().sum() / (other - other.mean(0)).square().sum()
        assert share == pytest.approx(1 - float(left))


def test_places_are_of_the_map_of_the_entitys_own_seed(tables: dict[str, pd.DataFrame]) -> None:
    vectors = insert_stack(*insert_tasks(4, "es", TRAINED)[0]).vectors
    for entity, seed in SEEDS_OF.items():
        model = POINTS.seeds.index(seed)
        known = [row for row in range(ENTITIES) if row not in POINTS.novel[model, 0]]
        axes = Plane.of(TRAINED.entity[model, known])
        places = tables["places"]
        rows_of_entity = places[places["seed"] == seed].set_index(["model", "epoch", "entity"]).sort_index()
        assert rows_of_entity.loc["theta0", 0].index.tolist() == known
        expected = axes.project(torch.as_tensor(vectors[model, POINTS.novel[model, 0].tolist().index(entity)]))
        assert rows_of_entity.loc[("es", 0, entity), ["x", "y"]].tolist() == pytest.approx(expected.tolist(), abs=1e-6)
        assert {("joint", 0, entity), ("es", EXPLORER.epochs, entity)} <= set(rows_of_entity.index)


# Indicators


def test_indicators_are_those_whose_centroid_was_taken(tables: dict[str, pd.DataFrame]) -> None:
    indicators = tables["indicators"]
    assert set(indicators["model"]) == {"es", "rs", "ers", "soft_hybrid"}
    number = indicators.groupby(["model", "entity"]).size()
    assert (number.loc["es"] == 3).all()
    assert (number.loc["soft_hybrid"] == EXPLORER.indicators).all()
    vectors = insert_stack(*insert_tasks(4, "es", TRAINED)[0]).vectors
    unit = WORDS / np.linalg.norm(WORDS, axis=1, keepdims=True)
    for entity, seed in SEEDS_OF.items():
        rows_of_entity = indicators[(indicators["model"] == "es") & (indicators["entity"] == entity)]
        place = POINTS.novel[seed, 0].tolist().index(entity)
        centre = TRAINED.entity[seed, rows_of_entity["indicator"].tolist()].mean(0).numpy()
        assert centre == pytest.approx(vectors[seed, place], abs=1e-6)
        assert rows_of_entity["weight"].tolist() == pytest.approx([1 / 3] * 3)
        assert rows_of_entity["by_words"].is_monotonic_decreasing
        assert rows_of_entity["by_words"].tolist() == pytest.approx(
            (unit[rows_of_entity["indicator"]] @ unit[entity]).tolist(), abs=1e-6
        )


# Answers

#: f(h, r, t) = h · r · t of numbers. Entity 3 is novel, entity 5 takes no part; kinds are 0, 1, 2, 0, 1, 2.
GRAPH = graph_of(
    {(0, 0, 1): 2, (3, 0, 0): 4, (3, 0, 1): 1, (3, 0, 4): 1, (0, 1, 4): 5, (5, 1, 3): 2, (0, 1, 2): 1}, 6, 2
)
SPLITS = np.array([[TRAIN, TRAIN, VALID, TRAIN, TEST, OUT, TRAIN]], dtype=np.int8)
BY_HAND = GridPoints("home", GRAPH, 1, [7], SPLITS, np.array([[[3]]]), np.array([[1, 0, 0, 1]]))


def answered(first: int, *numbers: float) -> pd.DataFrame:
    entity = torch.zeros(1, 6, 4)
    entity[0, :, 0] = torch.tensor(numbers)
    relation = torch.zeros(1, 2, 4)
    relation[..., 0] = 1
    shown = ShownEntities.of(BY_HAND, {3: 7})
    return first_answers(Embedding(entity, relation, ANALOGY), BY_HAND, shown, *queries_of(BY_HAND, shown), first)


def test_answers_by_hand() -> None:
    rows = answered(1, 1.0, 2.0, 9.0, 1.0, 2.0, 99.0).fillna("")
    assert set(rows["entity"]) == {3}
    answers_of = {key: list(rows_of_entity[["answer", "rank", "true"]].itertuples(index=False, name=None))
             for key, rows_of_entity in rows.groupby(["relation", "hidden"])}  # fmt: skip
    # kind 0 is an end of each relation on either side; 2 comes first and is not true; 1 and 4 are equal, so go by id
    assert answers_of == {
        ("relation 0", "tail"): [(2, 1, ""), (1, 2, "held_out"), (4, 3, "learned"), (0, 4, "told")],
        ("relation 0", "head"): [(2, 1, "")],
        ("relation 1", "tail"): [(2, 1, "")],
        ("relation 1", "head"): [(2, 1, "")],
    }


def test_answers_are_those_of_every_model_as_inserted_and_after_training(tables: dict[str, pd.DataFrame]) -> None:
    answers, entities = tables["answers"], tables["entities"]
    steps = {(name, epoch) for name in (*SHOWN, "soft_hybrid") for epoch in (0, EXPLORER.epochs)}
    assert set(answers.groupby(["model", "epoch"]).groups) == steps | {("joint", 0)}
    ranks = answers.groupby(["entity", "model", "epoch", "relation", "hidden"])["rank"]
    assert (ranks.min() == 1).all()
    assert ranks.apply(lambda rank: rank.is_monotonic_increasing and set(range(1, 4)) <= set(rank)).all()
    true = answers.dropna(subset="true").groupby(["model", "epoch"]).size()
    assert set(true) == {true.iloc[0]}
    assert set(entities["entity"]) == set(SEEDS_OF)
    rows = POINTS.insert_triples
    expected = {int(POINTS.novel[model, 0, place]): int(((rows[:, 1] == model) & (rows[:, 2] == place)).sum())
                for model in range(4) for place in range(2)
                if SEEDS_OF[int(POINTS.novel[model, 0, place])] == POINTS.seeds[model]}  # fmt: skip
    assert dict(zip(entities["entity"], entities["told"], strict=True)) == expected


def test_a_seed_has_the_same_bits_in_a_stack_and_alone() -> None:
    together = [single_insertions(*explorer_task(configs=4))]
    alone = [single_insertions(*explorer_task(1, n, configs=4)) for n in range(4) if n in SEEDS_OF.values()]
    for name, (table, order) in TABLES.items():
        one, other = (
            pd.concat(part[name] for part in parts).sort_values(order, kind="stable")[list(table.columns)]
            for parts in (together, alone)
        )
        pd.testing.assert_frame_equal(one.reset_index(drop=True), other.reset_index(drop=True), check_exact=True)
