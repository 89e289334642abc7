"""The grid gives the same bits however it is cut and spread, and the same draws to every initializer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pandas as pd
import pytest
import torch

from isi.analyses.cross_validation import CrossValidation, best_looks, fold_tasks
from isi.analyses.model_comparison import ModelTask, measure, rows
from isi.analyses.trajectory import TrajectoryTask, place_of_interest, trace_trajectory
from isi.evaluation.convergence import SCOPES as CONVERGING
from isi.experiment import runner
from isi.experiment.grid import StackedVectors
from isi.experiment.insert import InsertTask, insert_stack, run_sessions
from isi.experiment.runner import Compute, HasPoints
from isi.experiment.train import (
    EvaluationTask,
    TrainResult,
    TrainTask,
    evaluate_stack,
    joint_tasks,
    joint_tensors,
    joint_vectors,
    train_stack,
)
from isi.graph.sessions import TRAIN
from isi.models.model import MODELS, make_model
from tests.small_graphs import ANALOGY, points_of
from tests.small_grid import (
    ENTITIES,
    FAMILY_OPTIONS,
    GRAPH,
    INITIALIZERS,
    LEARNING,
    MARGIN,
    OPTIMIZER,
    SCOPES,
    SEEDS,
    SIZE,
    WORDS,
    all_insert_triples,
    csv,
    insert_tasks,
    inserted_bytes,
    joint_training_tasks,
    stacks,
    theta0,
    trained_bytes,
    training_tasks,
)

Task = TypeVar("Task", bound=HasPoints)
Done = TypeVar("Done")


def cut(tasks: Callable[[int], list[Task]], function: Callable[[Task], Done], workers: int) -> dict[int, list[Done]]:
    """Results of the grid in stacks of 1, 2 and 4 seeds, by height, all run by the same workers."""
    grids = {height: tasks(height) for height in (1, 2, 4)}
    every = [task for grid in grids.values() for task in grid]
    done = iter(runner.run(function, every, Compute(workers=workers, stack=4), "test"))
    return {height: [next(done) for _ in grid] for height, grid in grids.items()}


def test_learning_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks() -> None:
    one, two = (cut(training_tasks, train_stack, workers) for workers in (1, 2))
    expected = trained_bytes(one[2])
    for height, learned in [*one.items(), *two.items()]:
        assert trained_bytes(learned) == expected
        seeds = [result.log["seed"].unique().tolist() for result in learned]
        assert seeds == [points.seeds for points in stacks(height)]  # in the order of the tasks


def test_insertion_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks() -> None:
    trained = {steps: theta0(steps=steps) for steps in (1, 2)}
    cases = [(name, steps) for name in ("xavier", "ers", "gaussian", "es_permuted") for steps in trained]

    def tasks(height: int) -> list[InsertTask]:
        return [task for name, steps in cases for task in insert_tasks(height, name, trained[steps], steps=steps)]

    one, two = (cut(tasks, insert_stack, workers) for workers in (1, 2))
    for place in range(len(cases)):
        grids = [
            inserted_bytes(inserted[place * len(inserted) // len(cases) : (place + 1) * len(inserted) // len(cases)])
            for inserted in (*one.values(), *two.values())
        ]
        assert all(grid == grids[0] for grid in grids)


@pytest.mark.parametrize("name", MODELS.names())
def test_every_family_gives_the_same_bits_for_any_height_of_stacks(name: str) -> None:
    how = replace(LEARNING, model=make_model(name, FAMILY_OPTIONS.get(name, {}), f"models.{name}"))
    trained = theta0(how)
    learned, inserted = (
        [kind([function(task) for task in tasks(height)]) for height in (1, 2, 4)]
        for kind, function, tasks in (
            (trained_bytes, train_stack, lambda height: joint_training_tasks(height, how)),
            (inserted_bytes, insert_stack, lambda height: insert_tasks(height, "ers", trained)),
        )
    )
    for grids in (learned, inserted):
        assert grids[0] == grids[1] == grids[2]


def test_theta0_knows_no_novel_entity_and_the_joint_model_knows_all() -> None:
    (task,) = training_tasks(4, steps=2)
    initial, joint = train_stack(task), train_stack(replace(task, points=task.points.all_known))
    for model, novel in enumerate(task.points.novel):
        assert set(np.flatnonzero(~initial.known[model])) == set(novel.ravel().tolist())
        assert set(np.flatnonzero((initial.entity[model] == 0).all(-1))) == set(novel.ravel().tolist())
    assert joint.known.all()
    assert (joint.entity != 0).any(-1).all()


def test_novel_sets_and_queries_are_shared_by_all_initializers() -> None:
    trained = theta0()
    found = {name: insert_stack(insert_tasks(4, name, trained)[0]) for name in INITIALIZERS}
    key = ["size", "seed", "session", "epoch", "scope"]
    at_once = {name: result.runs[result.runs["epoch"] == 0].set_index(key) for name, result in found.items()}
    first, first_own = at_once["xavier"], found["xavier"].entities
    for name, result in found.items():
        assert at_once[name]["queries"].equals(first["queries"])
        own = result.entities[["size", "seed", "session", "entity", "queries"]]
        assert own.equals(first_own[own.columns])
    assert len({result.vectors.tobytes() for result in found.values()}) == len(found)


def test_batches_and_negatives_are_shared_by_all_initializers() -> None:
    trained, wordless = theta0(), np.zeros_like(WORDS)
    (by_words,), (by_relations,) = (insert_tasks(4, name, trained, wordless) for name in ("es", "rs"))
    assert by_words.config.options != by_relations.config.options
    same = [
        insert_stack(replace(task, config=replace(task.config, options={"k": 4}))) for task in (by_words, by_relations)
    ]
    assert same[0].vectors.tobytes() == same[1].vectors.tobytes()  # ES falls back to RS
    assert same[0].runs.equals(same[1].runs)
    assert set(same[0].entities["fallback"]) == {"rs"} != set(same[1].entities["fallback"])


def test_insertion_measures_novel_once_and_the_other_scopes_every_epoch() -> None:
    (task,) = insert_tasks(4, "es", theta0(), full_curves=[SIZE])
    epochs = insert_stack(task).runs.groupby(["seed", "scope"])["epoch"].apply(list)
    for seed in SEEDS:
        assert epochs[seed, "novel"] == [0]
        for scope in SCOPES - {"novel"}:
            assert epochs[seed, scope] == list(range(OPTIMIZER.max_epochs + 1))


def test_insertion_stops_once_within_the_margin_of_the_joint_model() -> None:
    (task,) = insert_tasks(4, "es", theta0())
    at_once = insert_stack(task).runs.query("seed == 1 and epoch == 0").set_index("scope")["mrr_star"]
    for (_, scope), joint in task.joint.items():
        joint[1] = at_once[scope] + 0.8 * MARGIN
    runs = insert_stack(task).runs.sort_values("epoch")
    reached_at = []
    for model, seed in enumerate(SEEDS):
        reached = []
        for (_, scope), joint in task.joint.items():
            mrr_star = runs[(runs["seed"] == seed) & (runs["scope"] == scope)]["mrr_star"]
            reached.append(np.logical_or.accumulate(mrr_star.to_numpy() >= joint[model] - MARGIN))
        both = np.stack(reached).all(0)
        assert not both[:-1].any()
        assert both[-1] or len(both) == OPTIMIZER.max_epochs + 1
        reached_at.append(len(both) - 1 if both[-1] else None)
    assert reached_at[:2] == [0, 0]
    assert reached_at[3] is None  # its joint model is out of reach


def test_the_joint_model_of_each_session_is_measured_in_all_scopes_of_that_session() -> None:
    (points,) = stacks(4, steps=2)
    tasks = joint_tasks([points], LEARNING)
    joint = joint_vectors(joint_tensors(tasks, [train_stack(task) for task in tasks]), LEARNING.model, points)
    insert_triples = all_insert_triples(points)
    runs = evaluate_stack(EvaluationTask(points, joint, insert_triples))
    assert set(runs["epoch"]) == {0}
    assert set(runs["size"]) == {SIZE}
    found = sorted(zip(runs["session"], runs["seed"], runs["scope"], strict=True))
    assert found == sorted((session, seed, scope) for session in (1, 2) for seed in SEEDS for scope in SCOPES)
    novel = runs[runs["scope"] == "novel"].set_index(["session", "seed"])["queries"]
    for model, seed in enumerate(SEEDS):
        touching, later = (np.isin(GRAPH.triples[:, [0, 2]], novel).any(1) for novel in points.novel[model])
        first, second = ((insert_triples[:, :2] == (session, model)).all(1).sum() for session in (1, 2))
        assert novel[1, seed] == (touching & ~later).sum() - first
        assert novel[2, seed] == later.sum() - second
    asked = runs[runs["queries"] > 0]
    assert asked["mrr_star"].between(0, 1).all()
    assert runs[runs["queries"] == 0]["mrr_star"].isna().all()
    # trained for 8 epochs on what it is asked about: better than a guess among 14
    assert asked[asked["scope"] == "all"]["mrr_star_entity"].mean() > 0.2


def test_the_joint_model_of_a_session_has_not_seen_what_arrives_later() -> None:
    (points,) = stacks(4, steps=2)
    tasks = joint_tasks([points], LEARNING)
    first, last = joint_vectors(joint_tensors(tasks, [train_stack(task) for task in tasks]), LEARNING.model, points)
    for model, (novel1, novel2) in enumerate(points.novel):
        assert not first.entity[model, novel2].any()
        assert first.entity[model, novel1].any(-1).all()
        assert last.entity[model].any(-1).all()
    ends = GRAPH.triples[:, [0, 2]].numpy()
    later = np.stack([np.isin(ends, novel).any(1) for novel in points.novel[:, 1]])
    other_splits = replace(points, splits=np.where(later, TRAIN, points.splits).astype(np.int8))
    assert np.array_equal(train_stack(replace(tasks[1], points=other_splits)).entity, first.entity)
    alone = train_stack(TrainTask(points.all_known, LEARNING))
    assert np.array_equal(last.entity, alone.entity)  # of the last session, what it is with any number of sessions


def test_with_one_session_there_is_one_joint_model_of_each_seed() -> None:
    grid = [*stacks(2), points_of(GRAPH, 1, SEEDS)]
    tasks = joint_tasks(grid, LEARNING)
    assert [task.points.seeds for task in tasks] == [SEEDS[:2], SEEDS[2:]]
    tensors = joint_tensors(tasks, [train_stack(task) for task in tasks])
    assert set(tensors) == {"entity", "relation", "known", "seed"}
    for points in grid:
        (joint,) = joint_vectors(tensors, LEARNING.model, points)
        rows = [SEEDS.index(seed) for seed in points.seeds]
        assert np.array_equal(joint.entity, tensors["entity"][rows].numpy())


# Sessions that insert one after the other


def joint_of(first: float, second: float) -> Mapping[tuple[int, str], np.ndarray]:
    """MRR* to reach in two sessions: NaN, which is none to reach, or what never is."""
    return {(s, scope): np.full(len(SEEDS), mrr) for s, mrr in ((1, first), (2, second)) for scope in CONVERGING}


def two_sessions(name: str, first: float, second: float) -> InsertTask:
    (task,) = insert_tasks(4, name, theta0(steps=2), steps=2)
    return replace(task, joint=joint_of(first, second))


def test_a_session_inserts_into_what_the_one_before_has_learned_and_leaves_it_as_it_is() -> None:
    task = two_sessions("mean", 2.0, np.nan)  # the first session is fine-tuned, the second is not
    (first, second), before = run_sessions(task), task.theta0.entity
    for model, (novel1, novel2) in enumerate(task.points.novel):
        learned, after = first.theta.entity[model], second.theta.entity[model]
        d0, d1 = (task.points.session(number).entities[model] for number in (0, 1))
        assert not torch.equal(learned[d0], torch.from_numpy(before[model])[d0])
        assert not torch.equal(learned[novel1], first.initial.vectors[model])
        assert not learned[novel2].any()  # nobody knows them yet
        assert torch.equal(after[d1], learned[d1])
        assert torch.equal(after[novel2], second.initial.vectors[model])
        assert torch.allclose(first.initial.vectors[model, 0], torch.from_numpy(before[model])[d0].mean(0), atol=1e-6)
        assert torch.allclose(second.initial.vectors[model, 0], learned[d1].mean(0), atol=1e-6)
    assert torch.equal(second.theta.relation, first.theta.relation)


def test_known_entities_of_the_first_session_go_on_learning_in_the_second() -> None:
    task = two_sessions("mean", np.nan, 2.0)  # the first session is not fine-tuned, the second is
    first, second = run_sessions(task)
    for model, (novel1, novel2) in enumerate(task.points.novel):
        assert torch.equal(first.theta.entity[model, novel1], first.initial.vectors[model])
        for novel in (novel1, novel2):
            assert not torch.equal(second.theta.entity[model, novel], first.theta.entity[model, novel])


def test_a_later_session_is_told_its_own_triples_and_knows_who_came_before() -> None:
    task = two_sessions("rs", np.nan, np.nan)
    first, _ = run_sessions(task)
    given, seen = task.novel_entities(2), task.context(first.theta, 2)
    came_before = 0
    for model, (novel1, novel2) in enumerate(task.points.novel):
        assert seen.known[model, novel1].all()
        assert not seen.known[model, novel2].any()
        ends = set(seen.other[model][seen.observed[model]].tolist())
        assert not ends & set(novel2.tolist())
        came_before += len(ends & set(novel1.tolist()))
        rows = given.insert_triples[given.insert_triples[:, 0] == model, 2]
        assert seen.observed[model].sum() == len(rows)
        assert np.isin(GRAPH.triples[rows][:, [0, 2]], novel2).any(1).all()
    assert came_before  # some triple ties the two sessions
    assert task.keys(2).tolist() == [[SIZE, seed, 2] for seed in SEEDS]
    assert task.keys(1).tolist() == [[SIZE, seed] for seed in SEEDS]


def test_insertion_gives_rows_of_every_session() -> None:
    (task,) = insert_tasks(4, "es", theta0(steps=2), steps=2, full_curves=[SIZE])
    inserted = insert_stack(task)
    assert inserted.vectors.shape == (len(SEEDS), 2 * SIZE, LEARNING.dimension)
    epochs = inserted.runs.groupby(["seed", "session", "scope"])["epoch"].apply(list)
    rows = inserted.entities.sort_values(["seed", "session", "entity"])
    for model, seed in enumerate(SEEDS):
        for session in (1, 2):
            assert epochs[seed, session, "novel"] == [0]
            for scope in SCOPES - {"novel"}:
                assert epochs[seed, session, scope] == list(range(OPTIMIZER.max_epochs + 1))
            own = rows[(rows["seed"] == seed) & (rows["session"] == session)]
            assert own["entity"].tolist() == task.points.novel[model, session - 1].tolist()
    known = inserted.runs.query("scope == 'known' and epoch == 0").set_index(["session", "seed"])["queries"]
    for seed in SEEDS:
        assert known[2, seed] > known[1, seed]


@pytest.mark.parametrize("session", [1, 2])
def test_each_session_stops_at_its_own_target(session: int) -> None:
    targets = [2.0, 2.0]
    targets[session - 1] = np.nan
    last = insert_stack(two_sessions("es", *targets)).runs.groupby("session")["epoch"].max()
    assert last.to_dict() == {session: 0, 3 - session: OPTIMIZER.max_epochs}


# Studies


@pytest.mark.parametrize("name", INITIALIZERS)
def test_a_trace_is_of_one_entity_of_the_experiment_and_its_indicators(name: str) -> None:
    trained = theta0()
    (stack,), alone = insert_tasks(4, name, trained), insert_tasks(1, name, trained)[2]

    def followed(epochs: int) -> TrajectoryTask:
        return TrajectoryTask(**vars(replace(alone, config=alone.config.training(max_epochs=epochs))), place=1)

    short, long = (trace_trajectory(followed(epochs)) for epochs in (2, 4))
    assert (len(short.path), len(long.path)) == (3, 5)
    assert short.path[0].tobytes() == insert_stack(stack).vectors[2, 1].tobytes()
    assert short.path.tobytes() == long.path[:3].tobytes()
    assert not np.array_equal(long.path[3], long.path[4])
    assert short.indicators.sum() == INITIALIZERS[name].get("k", ENTITIES - SIZE if name == "mean" else 0)
    if short.indicators.any():
        assert np.allclose(trained.entity[2][short.indicators].mean(0), short.path[0], atol=1e-6)


def test_a_trace_takes_an_object_that_has_words_and_insert_triples() -> None:
    task = insert_tasks(1, "ers", theta0())[0]
    first, second = task.points.novel[0, 0]
    kinds = pd.Series("object", index=range(ENTITIES))
    assert place_of_interest(task, kinds, "object") == 0
    assert place_of_interest(task, kinds.replace({"object": "room"}), "object") is None
    assert place_of_interest(task, kinds.where(kinds.index != first, "room"), "object") == 1
    wordless = WORDS * (np.arange(ENTITIES) != first)[:, None]
    assert place_of_interest(replace(task, words=wordless), kinds, "object") == 1
    of_second = task.insert_triples[task.insert_triples[:, 2] == 1]
    assert place_of_interest(replace(task, insert_triples=of_second), kinds, "object") == 1
    assert second > first


FEW = CrossValidation(
    experiments=["home"], folds=5, dimension=[8], ratio=[], learning_rate=[], weight_decay=[]
)  # fmt: skip


def test_families_are_measured_over_all_test_triples_with_what_training_took() -> None:
    (task,) = joint_training_tasks(4)
    (with_novel,) = stacks(4)
    learned = train_stack(task)
    theta, log = StackedVectors(ANALOGY, learned.entity, learned.relation), learned.log
    found = rows(measure(ModelTask(task.points, theta)), learned).set_index("seed")
    runs = evaluate_stack(EvaluationTask(with_novel, [theta], all_insert_triples(with_novel)))
    judged = runs[runs["scope"] == "all"].set_index("seed")
    columns = ["mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr", "queries"]
    pd.testing.assert_frame_equal(found[columns], judged[columns])
    for seed in SEEDS:
        own = log[log["seed"] == seed]
        assert found["epochs"][seed] == own["epoch"].max()
        assert found["valid_mrr_star"][seed] == own["mrr_star"].max()


def test_cross_validation_gives_the_same_bits_for_any_height_of_stacks() -> None:
    tables = []
    for height in (1, 2, 5):
        tasks = fold_tasks("home", GRAPH, FEW, LEARNING, height)
        assert max(len(task.points.seeds) for task in tasks) == height
        tables.append(csv(pd.concat(best_looks(task, train_stack(task)) for task in tasks)))
    assert tables[0] == tables[1] == tables[2]
    rows = pd.concat(best_looks(task, train_stack(task)) for task in tasks)
    assert rows[["dimension", "fold"]].to_numpy().tolist() == [[d, fold] for d in (12, 8) for fold in range(5)]


def test_the_best_look_at_a_fold_is_the_last_that_was_kept() -> None:
    log = pd.DataFrame(
        {"seed": [0, 0, 0, 1, 1, 1], "epoch": [2, 4, 6] * 2, "mrr_star": [0.3, 0.5, 0.4, 0.6, 0.5, 0.2],
         "kept": [True, True, False, True, False, False]}
    )  # fmt: skip
    task = fold_tasks("home", GRAPH, FEW, LEARNING, 5)[0]
    nothing = np.zeros(0)
    best = best_looks(task, TrainResult(nothing, nothing, nothing, log)).set_index("fold")
    assert best["mrr_star"].to_dict() == {0: 0.5, 1: 0.6}
    assert best["epoch"].to_dict() == {0: 4, 1: 2}
