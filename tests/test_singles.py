"""Single insertions: whose vectors make a centre, where vectors lie, and which answers come first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from isi.initializers.soft import soft_hybrid

from isi.analyses.single_insertions import (
    SHOWN,
    TABLES,
    ExplorerParams,
    Singles,
    SinglesTask,
    answers_of,
    first_seeds,
    pick,
    queries_of,
    single_insertions,
)
from isi.analyses.trajectory import on, plane, turn
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.insert import InsertConfig, InsertTask, insert_stack
from isi.experiment.train import TrainTask, train_stack
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, graph_of
from tests.small_grid import ENTITIES, LEARNING, MARGIN, OPTIMIZER, SAMPLED, WORDS, insert_tasks, stacks, theta0

SOFT = {"word_weight": 3.0, "relation_weight": 5.0}
HOW = ExplorerParams(
    experiments=["home"], size=2, epochs=OPTIMIZER.max_epochs, best="soft_hybrid", indicators=4, answers=3
)


def soft_task(trained: StackedVectors, words: np.ndarray = WORDS) -> InsertTask:
    (task,) = insert_tasks(4, "es", trained, words)
    return replace(task, config=InsertConfig("soft_hybrid", SOFT, 0, SAMPLED, OPTIMIZER, MARGIN))


def singles_task(height: int = 4, number: int = 0) -> SinglesTask:
    """Of all entities that are novel, each in the first seed that has it."""
    trained, (stack,) = theta0(), stacks(4)
    whole = train_stack(TrainTask(stack.all_known, LEARNING))
    rows = slice(number * height, (number + 1) * height)
    hows = [insert_tasks(height, name, trained)[number] for name in SHOWN]
    if height == 4:
        hows.append(soft_task(trained))
    novel = [(2, seed, entity, 1) for seed, own in zip(stack.seeds, stack.novel[:, 0], strict=True)
             for entity in own.tolist()]  # fmt: skip
    seeds = first_seeds(pd.DataFrame(novel, columns=["size", "seed", "entity", "session"]), 2)
    return SinglesTask(
        hows[0].points, hows, StackedVectors(ANALOGY, whole.entity[rows], whole.relation[rows]), seeds, HOW
    )


@pytest.fixture(scope="module")
def task() -> SinglesTask:
    return singles_task()


@pytest.fixture(scope="module")
def found(task: SinglesTask) -> Singles:
    return single_insertions(task)


def test_an_entity_is_shown_in_the_first_seed_whose_first_session_inserts_it() -> None:
    rows = [(2, 1, 7, 1), (2, 0, 8, 1), (2, 0, 9, 2), (1, 0, 7, 1), (2, 2, 8, 1), (2, 2, 7, 1)]
    assert first_seeds(pd.DataFrame(rows, columns=["size", "seed", "entity", "session"]), 2) == {8: 0, 7: 1}


# Places


def test_a_plane_holds_the_two_axes_of_most_variance() -> None:
    vectors = torch.tensor([[3.0, 0, 1, 0], [-3, 0, 1, 0], [0, -2, 1, 0], [0, 2, 1, 0], [0, 0, 2, 0], [0, 0, 0, 0]])
    found = plane(vectors)
    assert found.share == pytest.approx((18 + 8) / (18 + 8 + 2))
    places = on(found, torch.tensor([[3.0, 0, 1, 5], [0, 2, 1, 0]]))
    assert places.numpy() == pytest.approx(np.array([[3, 0], [0, 2]]), abs=1e-12)


def test_what_is_turned_scaled_and_moved_comes_back() -> None:
    rng = np.random.default_rng(1)
    onto = torch.as_tensor(rng.normal(size=(2, 9, 4)))
    rotation = torch.as_tensor(np.linalg.qr(rng.normal(size=(4, 4)))[0])
    known = torch.tensor([[True] * 6 + [False] * 3] * 2)
    turned, fitted = turn(0.3 * onto @ rotation + 7, onto, known)
    assert turned.numpy() == pytest.approx(onto.numpy(), abs=1e-9)
    assert fitted.tolist() == pytest.approx([1, 1])
    noisy = onto + torch.as_tensor(rng.normal(size=onto.shape))
    turned, fitted = turn(noisy, onto, known)
    for one, other, share in zip(turned[:, :6], onto[:, :6], fitted.tolist(), strict=True):
        left = (one - other).square().sum() / (other - other.mean(0)).square().sum()
        assert share == pytest.approx(1 - float(left))


def test_places_are_of_the_map_of_the_entitys_own_seed(task: SinglesTask, found: Singles) -> None:
    vectors, points = insert_stack(task.inserting[1]).vectors, task.points
    for entity, seed in task.seeds.items():
        model = points.seeds.index(seed)
        known = [own for own in range(ENTITIES) if own not in points.novel[model, 0]]
        axes = plane(torch.as_tensor(task.inserting[0].theta0.entity[model, known]))
        own = found.places[found.places["seed"] == seed].set_index(["model", "epoch", "entity"]).sort_index()
        assert own.loc["theta0", 0].index.tolist() == known
        expected = on(axes, torch.as_tensor(vectors[model, points.novel[model, 0].tolist().index(entity)]))
        assert own.loc[("es", 0, entity), ["x", "y"]].tolist() == pytest.approx(expected.tolist(), abs=1e-6)
        assert {("joint", 0, entity), ("es", HOW.epochs, entity)} <= set(own.index)


# Indicators


def test_weights_of_a_soft_hybrid_are_those_that_make_its_vector() -> None:
    wordless = WORDS * (np.arange(ENTITIES) % 4 > 0)[:, None]
    task = soft_task(theta0(), wordless)
    given = task.insert_triples
    alone = replace(task, insert_triples=given[given[:, 1] > 0])  # the first has none
    insertion = alone.context(task.theta0.stack, 1)
    initial = soft_hybrid(insertion, **SOFT)
    weights = initial.weights
    assert weights is not None
    assert torch.allclose(weights.float() @ insertion.theta0.entity, initial.vectors, atol=1e-6)
    assert len(initial.fallback.unique()) > 2


def test_indicators_are_those_whose_centroid_was_taken(task: SinglesTask, found: Singles) -> None:
    assert set(found.indicators["model"]) == {"es", "rs", "ers", "soft_hybrid"}
    assert (found.indicators.groupby(["model", "entity"]).size() == 3).loc["es"].all()
    assert (found.indicators.groupby(["model", "entity"]).size() == HOW.indicators).loc["soft_hybrid"].all()
    vectors = insert_stack(task.inserting[1]).vectors
    unit = WORDS / np.linalg.norm(WORDS, axis=1, keepdims=True)
    for entity, seed in task.seeds.items():
        own = found.indicators[(found.indicators["model"] == "es") & (found.indicators["entity"] == entity)]
        place = task.points.novel[seed, 0].tolist().index(entity)
        centre = task.inserting[0].theta0.entity[seed, own["indicator"]].mean(0)
        assert centre == pytest.approx(vectors[seed, place], abs=1e-6)
        assert own["weight"].tolist() == pytest.approx([1 / 3] * 3)
        assert own["by_words"].is_monotonic_decreasing
        assert own["by_words"].tolist() == pytest.approx((unit[own["indicator"]] @ unit[entity]).tolist(), abs=1e-6)


# Answers

#: f(h, r, t) = h · r · t of numbers. Entity 3 is novel, entity 5 takes no part; kinds are 0, 1, 2, 0, 1, 2.
GRAPH = graph_of(
    {(0, 0, 1): 2, (3, 0, 0): 4, (3, 0, 1): 1, (3, 0, 4): 1, (0, 1, 4): 5, (5, 1, 3): 2, (0, 1, 2): 1}, 6, 2
)
SPLITS = np.array([[TRAIN, TRAIN, VALID, TRAIN, TEST, OUT, TRAIN]], dtype=np.int8)
POINTS = GridPoints("home", GRAPH, 1, [7], SPLITS, np.array([[[3]]]))


def answered(first: int, *numbers: float) -> pd.DataFrame:
    entity = torch.zeros(1, 6, 4)
    entity[0, :, 0] = torch.tensor(numbers)
    relation = torch.zeros(1, 2, 4)
    relation[..., 0] = 1
    told = torch.tensor([[False, True, False, False, False, False, False]])
    asked = queries_of(POINTS, pick(POINTS, {3: 7}), told)
    return answers_of(Embedding(entity, relation, ANALOGY), POINTS, asked, first)


def test_answers_by_hand() -> None:
    rows = answered(1, 1.0, 2.0, 9.0, 1.0, 2.0, 99.0).fillna("")
    assert set(rows["entity"]) == {3}
    asked = {key: list(own[["answer", "rank", "true"]].itertuples(index=False, name=None))
             for key, own in rows.groupby(["relation", "hidden"])}  # fmt: skip
    # kind 0 is an end of each relation on either side; 2 comes first and is not true; 1 and 4 are equal, so go by id
    assert asked == {
        ("relation 0", "tail"): [(2, 1, ""), (1, 2, "held_out"), (4, 3, "learned"), (0, 4, "told")],
        ("relation 0", "head"): [(2, 1, "")],
        ("relation 1", "tail"): [(2, 1, "")],
        ("relation 1", "head"): [(2, 1, "")],
    }


def test_an_entity_that_is_shown_elsewhere_is_not_asked_about() -> None:
    assert len(pick(POINTS, {3: 8}).entity) == 0


def test_answers_are_those_of_every_model_as_inserted_and_after_training(task: SinglesTask, found: Singles) -> None:
    models = set(found.answers.groupby(["model", "epoch"]).groups)
    each = {(name, epoch) for name in (*SHOWN, "soft_hybrid") for epoch in (0, HOW.epochs)}
    assert models == each | {("joint", 0)}
    queries = found.answers.groupby(["entity", "model", "epoch", "relation", "hidden"])
    assert (queries["rank"].min() == 1).all()
    assert queries["rank"].apply(lambda ranks: ranks.is_monotonic_increasing and set(range(1, 4)) <= set(ranks)).all()
    true = found.answers.dropna(subset="true").groupby(["model", "epoch"]).size()
    assert set(true) == {true.iloc[0]}
    assert set(found.entities["entity"]) == set(task.seeds)
    told = task.inserting[0].insert_triples
    expected = {int(task.points.novel[model, 0, place]): int(((told[:, 1] == model) & (told[:, 2] == place)).sum())
                for model in range(4) for place in range(2)
                if task.seeds[int(task.points.novel[model, 0, place])] == task.points.seeds[model]}  # fmt: skip
    assert dict(zip(found.entities["entity"], found.entities["told"], strict=True)) == expected


# Workers


def test_a_seed_has_the_same_bits_in_a_stack_and_alone(task: SinglesTask) -> None:
    together = single_insertions(replace(task, inserting=task.inserting[:4]))
    alone = [single_insertions(singles_task(1, number)) for number in range(4) if number in task.seeds.values()]
    for what, (schema, order) in TABLES.items():
        one, other = (pd.concat(getattr(done, what) for done in parts).sort_values(order, kind="stable")
                      for parts in ([together], alone))  # fmt: skip
        columns = list(schema.columns)
        pd.testing.assert_frame_equal(
            one[columns].reset_index(drop=True), other[columns].reset_index(drop=True), check_exact=True
        )
