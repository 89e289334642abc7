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

from isi.evaluation.changes import CHANGES
from isi.evaluation.query_sets import GROUPS
from isi.evaluation.ranking import MEASURES
from isi.models.stack import Embedding
from isi.training import trainer
from stages import runner
from stages.cross_validate import CrossValidation, Setting, best_validations
from stages.finetune_only import finetune_without_insertion
from stages.insert import InsertTask, insert_stack
from stages.runner import Compute
from stages.trace_trajectory import place_of_traced
from stages.train_joint import evaluate_stack, joint_points
from stages.train_theta0 import TrainResult, train_stack
from stages.vary import train_models
from tests import small_grid as grid
from tests.small_graphs import points_of

COLUMNS = [*MEASURES, "queries"]
#: But ``weighted``, which takes both groups of all seeds.
SCOPES = {"known", "known_closed", "novel", "held_out", "novel_held_out"}


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


@pytest.mark.parametrize("name", ["xavier", "ers", "es_permuted"])
def test_insertion_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks(
    name: str,
) -> None:
    def tasks(height: int) -> list[InsertTask]:
        return grid.insert_tasks(height, name, grid.theta0())

    results = [
        inserted for workers in (1, 2) for inserted in cut(tasks, insert_stack, workers).values()
    ]
    first, *others = map(grid.inserted_bytes, results)
    assert all(other == first for other in others)


def test_novel_sets_and_queries_are_shared_by_all_initializers() -> None:
    trained = grid.theta0()
    results = [insert_stack(*grid.insert_tasks(4, name, trained)[0]) for name in grid.INITIALIZERS]
    of_runs = ["size", "seed", "scope", "queries"]
    of_queries = ["seed", "scope", "relation", "hidden", "novel", "queries"]
    first, *others = (
        (result.runs.query("epoch == 0")[of_runs], result.queries[of_queries]) for result in results
    )
    for runs, queries in others:
        pd.testing.assert_frame_equal(runs, first[0])
        pd.testing.assert_frame_equal(queries, first[1])
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
    assert (es.fallbacks, rs.fallbacks) == (len(grid.SEEDS) * grid.SIZE, 0)


def test_insertion_stops_once_both_groups_are_within_the_margin_at_one_epoch() -> None:
    (task,) = grid.insert_tasks(4, "es", grid.theta0())
    points, *rest, config = task
    whole = insert_stack(points, *rest, replace(config, full_curves=[grid.SIZE])).runs
    curves = whole.set_index(["seed", "scope", "epoch"])["mrr"].sort_index()
    joint = task[3]["none"]
    for group in GROUPS:  # of seed 1, so that it has converged right after insertion
        joint[group][1] = curves[1, group, 0] + 0.8 * grid.MARGIN
    runs = insert_stack(*task).runs.set_index(["seed", "scope", "epoch"])["mrr"].sort_index()
    for model, seed in enumerate(grid.SEEDS):
        within = [
            curves[seed, group].to_numpy() >= joint[group][model] - grid.MARGIN for group in GROUPS
        ]
        both = np.logical_and(*within)
        last = int(both.argmax()) if both.any() else grid.OPTIMIZER.max_epochs
        for group in GROUPS:
            assert runs[seed, group].tolist() == curves[seed, group][: last + 1].tolist()
        assert seed != 1 or last == 0
    assert not both.any()  # the last joint model is out of reach


def test_seeds_beyond_those_that_are_fine_tuned_are_measured_right_after_insertion_alone() -> None:
    ((*task, config),) = grid.insert_tasks(4, "es", grid.theta0(), full_curves=[grid.SIZE])
    whole, part = (insert_stack(*task, replace(config, finetuned=number)).runs for number in (4, 2))
    expected = whole[(whole["seed"] < 2) | (whole["epoch"] == 0)]
    order = ["seed", "epoch", "scope"]
    one, other = (runs.sort_values(order).reset_index(drop=True) for runs in (part, expected))
    pd.testing.assert_frame_equal(one, other, check_exact=True)
    epochs = list(range(grid.OPTIMIZER.max_epochs + 1))
    assert sorted(whole["epoch"].unique()) == epochs
    assert set(whole["scope"]) == SCOPES


def test_changes_of_the_measure_are_taken_at_every_epoch_and_prolong_training() -> None:
    (task,) = grid.insert_tasks(4, "es", grid.theta0())
    points, trained, words, joint, config = task
    joint = {"none": dict.fromkeys(GROUPS, np.zeros(4)), "one_group": {"weighted": np.full(4, 2.0)}}
    result = insert_stack(points, trained, words, joint, replace(config, changes=True))
    assert set(result.runs["scope"]) == SCOPES
    assert set(result.changes["change"]) == set(CHANGES)
    for frame in (result.runs, result.changes):
        assert sorted(frame["epoch"].unique()) == list(range(grid.OPTIMIZER.max_epochs + 1))
    keys = ["seed", "epoch", "scope"]
    same = result.changes[result.changes["change"] == "none"].set_index(keys)["value"]
    assert same.to_dict() == result.runs.set_index(keys)["mrr"][same.index].to_dict()


def test_joint_models_of_one_split_are_shared_by_all_seeds_and_their_mean_is_taken() -> None:
    points = grid.stacks(4)[0]
    same = replace(points, splits=np.repeat(points.splits[:1], 4, 0))
    seeds = replace(same, seeds=[4, 5, 6, 7])
    (shared,) = joint_points([same, seeds], shares_split=True)
    assert (shared.seeds, shared.size) == ([0, 1, 2, 3, 4], 0)
    assert np.array_equal(shared.splits, np.repeat(points.splits[:1], 5, 0))
    apart = joint_points([points, replace(points, size=7)], shares_split=False)
    assert [each.seeds for each in apart] == [points.seeds]
    theta = train_stack(shared, grid.LEARNING).theta
    models = [grid.some_models(theta, [place] * 4) for place in range(5)]
    mean = evaluate_stack(same, models)
    each = [evaluate_stack(same, [model]) for model in models]
    keys = ["seed", "scope", "queries"]
    pd.testing.assert_frame_equal(mean[keys], each[0][keys])
    for measure in MEASURES:
        values = np.mean([frame[measure] for frame in each], 0)
        assert mean[measure].to_numpy() == pytest.approx(values, nan_ok=True)
    assert (each[0]["mrr"] != each[1]["mrr"]).any()


def test_the_joint_model_is_measured_in_all_scopes() -> None:
    (points,) = grid.stacks(4)
    runs = evaluate_stack(points, train_models(points, grid.LEARNING)[1])
    assert set(runs["epoch"]) == {0}
    assert set(runs["size"]) == {grid.SIZE}
    cells = sorted(zip(runs["seed"], runs["scope"], strict=True))
    assert cells == sorted((seed, scope) for seed in grid.SEEDS for scope in SCOPES)
    # trained for 8 epochs on the queried triples: better than a guess among 14
    assert runs[runs["scope"] == "held_out"]["mrr_entity"].mean() > 0.2


# Analyses


def test_a_trace_takes_an_object_that_has_words_and_insert_triples() -> None:
    points, trained, *_ = grid.insert_tasks(1, "ers", grid.theta0())[0]
    first, second = points.novel[0]
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
        points, insert_triples=points.insert_triples[points.insert_triples[:, 1] == 1]
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
    runs = finetune_without_insertion(
        points_of(grid.GRAPH, grid.SIZE, grid.SEEDS), trained, 0, grid.SAMPLED, grid.OPTIMIZER
    )
    runs = runs.query("epoch == 0").set_index("seed")
    (inserting,) = grid.insert_tasks(len(grid.SEEDS), "es", trained)
    inserted = (
        insert_stack(*inserting)
        .runs.query("epoch == 0 and scope == 'known_closed'")
        .set_index("seed")
    )
    pd.testing.assert_frame_equal(runs[COLUMNS], inserted[COLUMNS], check_exact=True)


def test_fine_tuning_alone_moves_known_entities_and_no_novel_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ended: list[Embedding] = []

    def recorded(*arguments: object) -> Embedding:
        ended.append(trainer.train(*arguments))  # type: ignore[arg-type]
        return ended[-1]

    monkeypatch.setattr("stages.finetune_only.train", recorded)
    points, trained = points_of(grid.GRAPH, grid.SIZE, grid.SEEDS), grid.theta0()
    finetune_without_insertion(points, trained, 0, grid.SAMPLED, grid.OPTIMIZER)
    (after,), before = ended, trained
    still = (after.entity == before.entity).all(-1)
    for model, novel in enumerate(points.novel.tolist()):
        assert set(torch.where(still[model])[0].tolist()) == set(novel)
    assert not torch.equal(after.relation, before.relation)
