"""The grid gives the same bits however it is cut and spread, and the same draws to every initializer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from isi import params, paths
from isi.experiments import executor
from isi.experiments.cells import Cells
from isi.experiments.cross_validation import best_looks, fold_tasks
from isi.experiments.insertion import FineTuning, Inserted, InsertTask, insert
from isi.experiments.judging import JudgingTask, judge
from isi.experiments.learning import Learned, Learning, LearningTask, as_tensors, learn_initial, learn_joint
from isi.experiments.tracing import TraceTask, place_of_interest, trace
from isi.params import Compute, CrossValidation, EmbeddingParams, Negatives, Optimizer, Option, Training
from tests.graphs import cells_of, insert_triples_of, random_graph

ENTITIES, RELATIONS, SIZE, SEEDS = 14, 3, 2, [0, 1, 2, 3]
Task = TypeVar("Task", bound=Cells)
Done = TypeVar("Done")
GRAPH = random_graph(ENTITIES, RELATIONS, 90)
SAMPLED = Negatives(mode="sampled", ratio=3, head_pool="unseen")
LEARNING = Learning(
    root=0,
    embedding=EmbeddingParams(dimension=12, init_range=0.01),
    negatives=SAMPLED,
    training=Training(
        batch_size=80, learning_rate=0.1, weight_decay=1e-3, max_epochs=8, evaluate_every=2, patience=1
    ),
)  # fmt: skip
TUNING = FineTuning(
    root=0,
    negatives=SAMPLED,
    optimizer=Optimizer(batch_size=80, learning_rate=0.05, weight_decay=1e-3, max_epochs=5),
    margin=0.05,
    to_the_end=[],
)
INITIALIZERS: dict[str, dict[str, Option]] = {
    "xavier": {}, "iu": {}, "es": {"k": 3}, "rs": {"k": 4}, "ers": {"k": 2, "candidates": 5},
    "mean": {}, "gaussian": {}, "gaussian_centred": {}, "es_permuted": {"k": 3},
}  # fmt: skip
WORDS = np.random.default_rng(0).normal(size=(ENTITIES, 6)).astype(np.float32)
SCOPES = {"all", "known", "known_closed", "novel", "novel_heldout"}


def stacks(height: int) -> list[Cells]:
    return [cells_of(GRAPH, SIZE, SEEDS[first : first + height]) for first in range(0, len(SEEDS), height)]


def parts(cells: Cells) -> tuple[Any, ...]:
    return tuple(getattr(cells, field.name) for field in fields(Cells) if not field.kw_only)


def learning_tasks(height: int) -> list[LearningTask]:
    return [LearningTask(*parts(cells), LEARNING) for cells in stacks(height)]


def theta0() -> tuple[np.ndarray, np.ndarray]:
    (learned,) = (learn_initial(task) for task in learning_tasks(len(SEEDS)))
    return learned.entity, learned.relation


def insert_tasks(
    height: int, name: str, trained: tuple[np.ndarray, np.ndarray], words: np.ndarray = WORDS
) -> list[InsertTask]:
    tasks = []
    for number, cells in enumerate(stacks(height)):
        rows = slice(number * height, (number + 1) * height)
        embedding = (trained[0][rows], trained[1][rows])
        joint = {scope: np.array([0.1, 0.5, 0.6, 2.0])[rows] for scope in ("all", "novel_heldout")}
        tasks.append(
            InsertTask(
                *parts(cells), embedding, insert_triples_of(cells), name, INITIALIZERS[name], words, joint, TUNING
            )
        )  # fmt: skip
    return tasks


def cut(tasks: Callable[[int], list[Task]], function: Callable[[Task], Done], workers: int) -> dict[int, list[Done]]:
    """Results of the grid in stacks of 1, 2 and 4 seeds, by height, all run by the same workers."""
    grids = {height: tasks(height) for height in (1, 2, 4)}
    every = [task for grid in grids.values() for task in grid]
    done = iter(executor.run(function, every, Compute(workers=workers, stack=4), "test"))
    return {height: [next(done) for _ in grid] for height, grid in grids.items()}


def whole(learned: list[Learned]) -> dict[str, bytes]:
    """All that learning gave, in the order of seeds and epochs; floats in CSV are whole."""
    tensors = as_tensors(stacks(len(SEEDS) // len(learned)), learned)
    log = pd.concat([result.log for result in learned]).sort_values(["seed", "epoch"])
    return {name: tensor.numpy().tobytes() for name, tensor in tensors.items()} | {"log": csv(log)}


def tabled(inserted: list[Inserted]) -> dict[str, bytes]:
    """All that insertion gave, in the order of seeds, epochs and scopes."""
    runs = pd.concat([result.runs for result in inserted]).sort_values(["seed", "epoch", "scope"])
    entities = pd.concat([result.entities for result in inserted]).sort_values(["seed", "entity"])
    vectors = np.concatenate([result.vectors for result in inserted])
    return {"vectors": vectors.tobytes(), "runs": csv(runs), "entities": csv(entities)}


def csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False).encode()


def test_learning_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks() -> None:
    one, two = (cut(learning_tasks, learn_initial, workers) for workers in (1, 2))
    expected = whole(one[2])
    for height, learned in [*one.items(), *two.items()]:
        assert whole(learned) == expected
        seeds = [result.log["seed"].unique().tolist() for result in learned]
        assert seeds == [cells.seeds for cells in stacks(height)]  # in the order of the tasks


def test_insertion_gives_the_same_bits_for_1_and_2_workers_and_any_height_of_stacks() -> None:
    trained, names = theta0(), ("xavier", "ers", "gaussian", "es_permuted")

    def tasks(height: int) -> list[InsertTask]:
        return [task for name in names for task in insert_tasks(height, name, trained)]

    one, two = (cut(tasks, insert, workers) for workers in (1, 2))
    for place in range(len(names)):
        grids = [
            tabled(inserted[place * len(inserted) // len(names) : (place + 1) * len(inserted) // len(names)])
            for inserted in (*one.values(), *two.values())
        ]
        assert all(grid == grids[0] for grid in grids)


def test_theta0_knows_no_novel_entity_and_the_joint_model_knows_all() -> None:
    (task,) = learning_tasks(4)
    initial, joint = learn_initial(task), learn_joint(task)
    for model, novel in enumerate(task.novel):
        assert set(np.flatnonzero(~initial.known[model])) == set(novel.tolist())
        assert set(np.flatnonzero((initial.entity[model] == 0).all(-1))) == set(novel.tolist())
    assert joint.known.all()
    assert (joint.entity != 0).any(-1).all()


def test_novel_sets_and_queries_are_shared_by_all_initializers() -> None:
    trained = theta0()
    found = {name: insert(insert_tasks(4, name, trained)[0]) for name in INITIALIZERS}
    key = ["size", "seed", "epoch", "scope"]
    at_once = {name: result.runs[result.runs["epoch"] == 0].set_index(key) for name, result in found.items()}
    first, first_own = at_once["xavier"], found["xavier"].entities
    for name, result in found.items():
        assert at_once[name]["queries"].equals(first["queries"])
        own = result.entities[["size", "seed", "entity", "queries"]]
        assert own.equals(first_own[own.columns])
    assert len({result.vectors.tobytes() for result in found.values()}) == len(found)


def test_batches_and_negatives_are_shared_by_all_initializers() -> None:
    trained, wordless = theta0(), np.zeros_like(WORDS)
    (by_words,), (by_relations,) = (insert_tasks(4, name, trained, wordless) for name in ("es", "rs"))
    assert by_words.options != by_relations.options
    same = [insert(replace(task, options={"k": 4})) for task in (by_words, by_relations)]
    assert same[0].vectors.tobytes() == same[1].vectors.tobytes()  # ES falls back to RS
    assert same[0].runs.equals(same[1].runs)
    assert set(same[0].entities["fallback"]) == {"rs"} != set(same[1].entities["fallback"])


def test_insertion_measures_novel_once_and_the_other_scopes_every_epoch() -> None:
    (task,) = insert_tasks(4, "es", theta0())
    task = replace(task, tuning=replace(TUNING, to_the_end=[SIZE]))
    runs = insert(task).runs
    epochs = runs.groupby(["seed", "scope"])["epoch"].apply(list)
    for seed in SEEDS:
        assert epochs[seed, "novel"] == [0]
        for scope in SCOPES - {"novel"}:
            assert epochs[seed, scope] == list(range(TUNING.optimizer.max_epochs + 1))


def test_insertion_stops_once_within_the_margin_of_the_joint_model() -> None:
    (task,) = insert_tasks(4, "es", theta0())
    at_once = insert(task).runs.query("seed == 1 and epoch == 0").set_index("scope")["mrr_star"]
    for scope, joint in task.joint_mrr_star.items():
        joint[1] = at_once[scope] + 0.8 * TUNING.margin
    runs = insert(task).runs.sort_values("epoch")
    reached_at = []
    for model, seed in enumerate(SEEDS):
        reached = []
        for scope, joint in task.joint_mrr_star.items():
            mrr_star = runs[(runs["seed"] == seed) & (runs["scope"] == scope)]["mrr_star"]
            reached.append(np.logical_or.accumulate(mrr_star.to_numpy() >= joint[model] - TUNING.margin))
        both = np.stack(reached).all(0)
        assert not both[:-1].any()
        assert both[-1] or len(both) == TUNING.optimizer.max_epochs + 1
        reached_at.append(len(both) - 1 if both[-1] else None)
    assert reached_at[:2] == [0, 0]
    assert reached_at[3] is None  # its joint model is out of reach


def test_joint_is_judged_in_all_scopes_at_epoch_0() -> None:
    (task,) = learning_tasks(4)
    joint = learn_joint(task)
    runs = judge(JudgingTask(*parts(task), (joint.entity, joint.relation), insert_triples_of(task)))
    assert set(runs["epoch"]) == {0}
    assert set(runs["size"]) == {SIZE}
    assert sorted(zip(runs["seed"], runs["scope"], strict=True)) == sorted(
        (s, scope) for s in SEEDS for scope in SCOPES
    )
    novel = runs[runs["scope"] == "novel"].set_index("seed")["queries"]
    inserted = insert_triples_of(task)
    for model, seed in enumerate(SEEDS):
        touching = np.isin(task.graph.triples[:, [0, 2]], task.novel[model]).any(1).sum()
        assert novel[seed] == touching - (inserted[:, 0] == model).sum()
    asked = runs[runs["queries"] > 0]
    assert asked["mrr_star"].between(0, 1).all()
    assert runs[runs["queries"] == 0]["mrr_star"].isna().all()
    # trained for 8 epochs on what it is asked about: better than a guess among 14
    assert asked[asked["scope"] == "all"]["mrr_star_entity"].mean() > 0.2


def test_a_trace_is_of_one_entity_of_the_experiment_and_its_indicators() -> None:
    trained = theta0()
    for name in INITIALIZERS:
        (stack,), alone = insert_tasks(4, name, trained), insert_tasks(1, name, trained)[2]
        short, long = (trace(TraceTask(**vars(alone), place=1, epochs=epochs)) for epochs in (2, 4))
        assert short.path[0].tobytes() == insert(stack).vectors[2, 1].tobytes()
        assert short.path.tobytes() == long.path[:3].tobytes()
        assert not np.array_equal(long.path[3], long.path[4])
        assert short.indicators.sum() == INITIALIZERS[name].get("k", ENTITIES - SIZE if name == "mean" else 0)
        if short.indicators.any():
            assert np.allclose(trained[0][2][short.indicators].mean(0), short.path[0], atol=1e-6)


def test_a_trace_takes_an_object_that_has_words_and_insert_triples() -> None:
    task = insert_tasks(1, "ers", theta0())[0]
    first, second = task.novel[0]
    kinds = pd.Series("object", index=range(ENTITIES))
    assert place_of_interest(task, kinds) == 0
    assert place_of_interest(task, kinds.replace({"object": "room"})) is None
    assert place_of_interest(task, kinds.where(kinds.index != first, "room")) == 1
    wordless = WORDS * (np.arange(ENTITIES) != first)[:, None]
    assert place_of_interest(replace(task, words=wordless), kinds) == 1
    of_second = task.insert_triples[task.insert_triples[:, 1] == 1]
    assert place_of_interest(replace(task, insert_triples=of_second), kinds) == 1
    assert second > first


def test_cross_validation_gives_the_same_bits_for_any_height_of_stacks() -> None:
    raw = params.load(paths.PARAMS)
    few = CrossValidation(folds=5, dimension=[8], ratio=[], learning_rate=[], weight_decay=[])
    small = {"embedding": LEARNING.embedding, "training": LEARNING.training, "cross_validation": few}
    tables = []
    for height in (1, 2, 5):
        tasks = fold_tasks(GRAPH, raw.model_copy(update=small), "test", height)
        assert max(len(task.seeds) for task in tasks) == height
        tables.append(csv(pd.concat(best_looks(task, learn_joint(task)) for task in tasks)))
    assert tables[0] == tables[1] == tables[2]
    rows = pd.concat(best_looks(task, learn_joint(task)) for task in tasks)
    assert rows[["dimension", "fold"]].to_numpy().tolist() == [[d, fold] for d in (12, 8) for fold in range(5)]


def test_the_best_look_at_a_fold_is_the_last_that_was_kept() -> None:
    log = pd.DataFrame(
        {"seed": [0, 0, 0, 1, 1, 1], "epoch": [2, 4, 6] * 2, "mrr_star": [0.3, 0.5, 0.4, 0.6, 0.5, 0.2],
         "kept": [True, True, False, True, False, False]}
    )  # fmt: skip
    task = fold_tasks(GRAPH, params.load(paths.PARAMS), "test", 5)[0]
    nothing = np.zeros(0)
    best = best_looks(task, Learned(nothing, nothing, nothing, log)).set_index("fold")
    assert best["mrr_star"].to_dict() == {0: 0.5, 1: 0.6}
    assert best["epoch"].to_dict() == {0: 4, 1: 2}
