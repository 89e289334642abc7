"""The grid gives equal bits for all stack heights and workers,
and all initializers get equal random samples.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from isi.analyses.finetuning import finetune_only
from isi.analyses.joint_models import (
    CrossValidation,
    Setting,
    best_validations,
)
from isi.analyses.trajectory import place_of_traced
from isi.analyses.variants import train_models
from isi.evaluation.query_sets import CONVERGING, novel_query_set
from isi.evaluation.ranking import evaluate, measure_rows
from isi.experiment import runner
from isi.experiment.insert import (
    InsertTask,
    init_context,
    insert_sessions,
    insert_stack,
    with_vectors,
)
from isi.experiment.runner import Compute
from isi.experiment.train import TrainResult, evaluate_stack, train_stack
from isi.graph.sessions import TRAIN
from isi.models.stack import Embedding
from isi.training import trainer
from tests import small_grid as grid
from tests.small_graphs import points_of

MEASURES = ["mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr", "queries"]


def cut(
    tasks: Callable[[int], list[Any]], function: Callable[..., Any], workers: int
) -> dict[int, list[Any]]:
    """Results of the grid by stack height (1, 2 and 4 seeds);
    one call of ``run`` computes all of them.
    """
    grids = {height: tasks(height) for height in (1, 2, 4)}
    every = [task for grid in grids.values() for task in grid]
    done = iter(runner.run(function, every, Compute(workers=workers, stack=4), "test"))
    return {height: [next(done) for _ in grid] for height, grid in grids.items()}


def test_learning_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks() -> None:
    serial, parallel = (cut(grid.training_tasks, train_stack, workers) for workers in (1, 2))
    expected = grid.trained_bytes(serial[2])
    for height, learned in [*serial.items(), *parallel.items()]:
        assert grid.trained_bytes(learned) == expected
        seeds = [result.log["seed"].unique().tolist() for result in learned]
        # in the order of the tasks
        assert seeds == [points.seeds for points in grid.stacks(height)]


@pytest.mark.parametrize(("name", "steps"), [("xavier", 1), ("ers", 2), ("es_permuted", 2)])
def test_insertion_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks(
    name: str, steps: int
) -> None:
    def tasks(height: int) -> list[InsertTask]:
        return grid.insert_tasks(height, name, grid.theta0(steps), steps=steps)

    results = [
        inserted for workers in (1, 2) for inserted in cut(tasks, insert_stack, workers).values()
    ]
    first, *others = map(grid.inserted_bytes, results)
    assert all(other == first for other in others)


def test_novel_sets_and_queries_are_shared_by_all_initializers() -> None:
    trained = grid.theta0()
    results = [insert_stack(*grid.insert_tasks(4, name, trained)[0]) for name in grid.INITIALIZERS]
    key, entity_key = (
        ["size", "seed", "session", "scope", "queries"],
        ["size", "seed", "session", "entity", "queries"],
    )
    immediate = [
        result.runs[result.runs["epoch"] == 0][key].reset_index(drop=True) for result in results
    ]
    assert all(rows.equals(immediate[0]) for rows in immediate)
    assert all(
        result.entities[entity_key].equals(results[0].entities[entity_key]) for result in results
    )
    assert len({result.vectors.tobytes() for result in results}) == len(results)


def test_batches_and_negatives_are_shared_by_all_initializers() -> None:
    trained, wordless = grid.theta0(), np.zeros_like(grid.WORDS)
    (by_words,), (by_relations,) = (
        grid.insert_tasks(4, name, trained, wordless) for name in ("es", "rs")
    )
    assert by_words[-1].options != by_relations[-1].options
    es, rs = (
        insert_stack(*rest, replace(config, options={"k": 4}))
        for *rest, config in (by_words, by_relations)
    )
    assert es.vectors.tobytes() == rs.vectors.tobytes()  # ES falls back to RS
    assert es.runs.equals(rs.runs)
    assert set(es.entities["fallback"]) == {"rs"} != set(rs.entities["fallback"])


def test_insertion_stops_once_within_the_margin_of_the_joint_model() -> None:
    (task,) = grid.insert_tasks(4, "es", grid.theta0())
    immediate = (
        insert_stack(*task).runs.query("seed == 1 and epoch == 0").set_index("scope")["mrr_star"]
    )
    for (_, scope), joint in task[3].items():
        joint[1] = immediate[scope] + 0.8 * grid.MARGIN
    runs = insert_stack(*task).runs.sort_values("epoch")
    reached_at = []
    for model, seed in enumerate(grid.SEEDS):
        reached = []
        for (_, scope), joint in task[3].items():
            mrr_star = runs[(runs["seed"] == seed) & (runs["scope"] == scope)]["mrr_star"]
            reached.append(
                np.logical_or.accumulate(mrr_star.to_numpy() >= joint[model] - grid.MARGIN)
            )
        both = np.stack(reached).all(0)
        assert not both[:-1].any()
        assert both[-1] or len(both) == grid.OPTIMIZER.max_epochs + 1
        reached_at.append(len(both) - 1 if both[-1] else None)
    assert reached_at[:2] == [0, 0]
    assert reached_at[3] is None  # its joint model is out of reach


def test_the_joint_model_of_each_session_is_measured_in_all_scopes_of_that_session() -> None:
    (points,) = grid.stacks(4, steps=2)
    insert_triples = points.insert_triples
    runs = evaluate_stack(points, train_models(points, grid.LEARNING)[1])
    assert set(runs["epoch"]) == {0}
    assert set(runs["size"]) == {grid.SIZE}
    cells = sorted(zip(runs["session"], runs["seed"], runs["scope"], strict=True))
    assert cells == sorted(
        (session, seed, scope) for session in (1, 2) for seed in grid.SEEDS for scope in grid.SCOPES
    )
    novel = runs[runs["scope"] == "novel"].set_index(["session", "seed"])["queries"]
    for model, seed in enumerate(grid.SEEDS):
        touching, later = (
            np.isin(grid.GRAPH.triples[:, [0, 2]], novel).any(1) for novel in points.novel[model]
        )
        first, second = (
            (insert_triples[:, :2] == (session, model)).all(1).sum() for session in (1, 2)
        )
        assert novel[1, seed] == (touching & ~later).sum() - first
        assert novel[2, seed] == later.sum() - second
    queried = runs[runs["queries"] > 0]
    assert queried["mrr_star"].between(0, 1).all()
    assert runs[runs["queries"] == 0]["mrr_star"].isna().all()
    # trained for 8 epochs on the queried triples: better than a guess among 14
    assert queried[queried["scope"] == "all"]["mrr_star_entity"].mean() > 0.2


def test_the_joint_model_of_a_session_has_not_seen_what_arrives_later() -> None:
    (points,) = grid.stacks(4, steps=2)
    _, (first, last) = train_models(points, grid.LEARNING)
    for model, (novel1, novel2) in enumerate(points.novel):
        assert not first.entity[model, novel2].any()
        assert first.entity[model, novel1].any(-1).all()
        assert last.entity[model].any(-1).all()
    ends = grid.GRAPH.triples[:, [0, 2]].numpy()
    later = np.stack([np.isin(ends, novel).any(1) for novel in points.novel[:, 1]])
    other_splits = replace(points, splits=np.where(later, TRAIN, points.splits).astype(np.int8))
    assert np.array_equal(train_stack(other_splits, grid.LEARNING, 1).theta.entity, first.entity)
    alone = train_stack(points.all_known, grid.LEARNING).theta
    assert np.array_equal(last.entity, alone.entity)  # equal to the joint model of a single session


# Sessions that insert one after the other


def two_sessions(name: str, first: float, second: float) -> InsertTask:
    """A task with the joint model's MRR* in sessions 1 and 2; NaN: the session is not fine-tuned;
    2: never reached.
    """
    ((points, trained, words, _, config),) = grid.insert_tasks(
        4, name, grid.theta0(steps=2), steps=2
    )
    joint = {
        (s, scope): np.full(len(grid.SEEDS), mrr)
        for s, mrr in ((1, first), (2, second))
        for scope in CONVERGING
    }
    return points, trained, words, joint, config


def test_a_session_inserts_into_what_the_one_before_has_learned_and_leaves_it_as_it_is() -> None:
    task = two_sessions("mean", 2.0, np.nan)  # the first session is fine-tuned, the second is not
    ((theta1, first), (theta2, second)), points, before = (
        insert_sessions(*task),
        task[0],
        task[1].entity,
    )
    for model, (novel1, novel2) in enumerate(points.novel):
        learned, after = theta1.entity[model], theta2.entity[model]
        d0, d1 = (points.session(number).entities[model] for number in (0, 1))
        assert not torch.equal(learned[d0], before[model][d0])
        assert not np.array_equal(learned[novel1], first.vectors[model])
        assert not learned[novel2].any()  # entities of session 2 are not yet known
        assert torch.equal(after[d1], learned[d1])
        assert np.array_equal(after[novel2], second.vectors[model])
        assert np.allclose(first.vectors[model, 0], before[model][d0].mean(0), atol=1e-6)
        assert np.allclose(second.vectors[model, 0], learned[d1].mean(0), atol=1e-6)
    assert torch.equal(theta2.relation, theta1.relation)


def test_a_later_session_has_its_own_insert_triples_and_knows_the_entities_before() -> None:
    task = two_sessions("rs", np.nan, np.nan)
    points, ((theta1, _), _) = task[0], insert_sessions(*task)
    rows, context = points.insert_triples_in(2), init_context(points, theta1, grid.WORDS, 0, 2)
    came_before = 0
    for model, (novel1, novel2) in enumerate(points.novel):
        assert context.known[model, novel1].all()
        assert not context.known[model, novel2].any()
        ends = set(context.other[model][context.observed[model]].tolist())
        assert not ends & set(novel2.tolist())
        came_before += len(ends & set(novel1.tolist()))
        triples = rows[rows[:, 0] == model, 2]
        assert context.observed[model].sum() == len(triples)
        assert np.isin(grid.GRAPH.triples[triples][:, [0, 2]], novel2).any(1).all()
    assert came_before  # a triple connects entities of both sessions
    assert context.keys.tolist() == [[grid.SIZE, seed, 2] for seed in grid.SEEDS]


def test_a_later_session_is_measured_and_fine_tuned_with_its_own_triples() -> None:
    task = two_sessions("mean", np.nan, 2.0)  # the second session is fine-tuned, the first is not
    points, ((theta1, _), (theta2, second)) = task[0], insert_sessions(*task)
    novel, mask = points.novel_in(2), points.insert_mask(2)
    inserted = with_vectors(theta1, novel, torch.as_tensor(second.vectors))
    immediate = measure_rows(evaluate(inserted, novel_query_set(points.session(2), novel, mask)))
    expected = immediate[immediate["scope"] == "novel"]["mrr_star"].tolist()
    assert (
        second.runs.query("scope == 'novel' and epoch == 0")
        .sort_values("seed")["mrr_star"]
        .tolist()
        == expected
    )
    assert (
        (theta2.entity != inserted.entity).any(-1)[torch.arange(len(novel))[:, None], novel].all()
    )


def test_insertion_gives_rows_of_every_session() -> None:
    (task,) = grid.insert_tasks(4, "es", grid.theta0(steps=2), steps=2, full_curves=[grid.SIZE])
    inserted = insert_stack(*task)
    assert inserted.vectors.shape == (len(grid.SEEDS), 2 * grid.SIZE, grid.LEARNING.dimension)
    epochs = inserted.runs.groupby(["seed", "session", "scope"])["epoch"].apply(list)
    rows = inserted.entities.sort_values(["seed", "session", "entity"])
    for model, seed in enumerate(grid.SEEDS):
        for session in (1, 2):
            assert epochs[seed, session, "novel"] == [0]
            for scope in grid.SCOPES - {"novel"}:
                assert epochs[seed, session, scope] == list(range(grid.OPTIMIZER.max_epochs + 1))
            entities = rows[(rows["seed"] == seed) & (rows["session"] == session)]["entity"]
            assert entities.tolist() == task[0].novel[model, session - 1].tolist()
    known = inserted.runs.query("scope == 'known' and epoch == 0").set_index(["session", "seed"])[
        "queries"
    ]
    for seed in grid.SEEDS:
        assert known[2, seed] > known[1, seed]


# Analyses


def test_a_trace_takes_an_object_that_has_words_and_insert_triples() -> None:
    points, trained, *_ = grid.insert_tasks(1, "ers", grid.theta0())[0]
    first, second = points.novel[0, 0]
    kinds = pd.Series("object", index=range(grid.ENTITIES))
    assert place_of_traced(points, trained, grid.WORDS, kinds, "object") == 0
    assert (
        place_of_traced(points, trained, grid.WORDS, kinds.replace({"object": "room"}), "object")
        is None
    )
    assert (
        place_of_traced(
            points, trained, grid.WORDS, kinds.where(kinds.index != first, "room"), "object"
        )
        == 1
    )
    wordless = grid.WORDS * (np.arange(grid.ENTITIES) != first)[:, None]
    assert place_of_traced(points, trained, wordless, kinds, "object") == 1
    of_second = replace(
        points, insert_triples=points.insert_triples[points.insert_triples[:, 2] == 1]
    )
    assert place_of_traced(of_second, trained, grid.WORDS, kinds, "object") == 1
    assert second > first


FEW = CrossValidation(
    experiments=["home"], folds=5, dimension=[8], ratio=[], learning_rate=[], weight_decay=[]
).settings(Setting(dimension=12, ratio=3, learning_rate=0.1, weight_decay=1e-3))


def test_the_best_validation_on_a_fold_is_the_last_that_was_kept() -> None:
    log = pd.DataFrame(
        {
            "seed": [0, 0, 0, 1, 1, 1],
            "epoch": [2, 4, 6] * 2,
            "mrr_star": [0.3, 0.5, 0.4, 0.6, 0.5, 0.2],
            "kept": [True, True, False, True, False, False],
        }
    )
    best = best_validations(TrainResult(grid.theta0(), np.zeros(0), log), FEW[0])
    assert best.set_index("fold")["mrr_star"].to_dict() == {0: 0.5, 1: 0.6}
    assert best.set_index("fold")["epoch"].to_dict() == {0: 4, 1: 2}


def test_fine_tuning_alone_starts_where_every_insertion_starts() -> None:
    trained = grid.theta0()
    runs = finetune_only(
        points_of(grid.GRAPH, grid.SIZE, grid.SEEDS), trained, 0, grid.SAMPLED, grid.OPTIMIZER
    )
    runs = runs.query("epoch == 0").set_index("seed")
    (inserting,) = grid.insert_tasks(len(grid.SEEDS), "es", trained)
    inserted = (
        insert_stack(*inserting)
        .runs.query("epoch == 0 and scope == 'known_closed'")
        .set_index("seed")
    )
    pd.testing.assert_frame_equal(runs[MEASURES], inserted[MEASURES], check_exact=True)


def test_fine_tuning_alone_moves_known_entities_and_no_novel_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ended: list[Embedding] = []

    def recorded(*arguments: object) -> Embedding:
        ended.append(trainer.train(*arguments))  # type: ignore[arg-type]
        return ended[-1]

    monkeypatch.setattr("isi.analyses.finetuning.train", recorded)
    points, trained = points_of(grid.GRAPH, grid.SIZE, grid.SEEDS), grid.theta0()
    finetune_only(points, trained, 0, grid.SAMPLED, grid.OPTIMIZER)
    (after,), before = ended, trained
    still = (after.entity == before.entity).all(-1)
    for model, novel in enumerate(points.novel[:, 0].tolist()):
        assert set(torch.where(still[model])[0].tolist()) == set(novel)
    assert not torch.equal(after.relation, before.relation)
