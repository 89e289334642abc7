"""One step of incremental learning: what it measures at once, and on what it learns on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from isi.errors import InputError
from isi.evaluation.convergence import SCOPES
from isi.experiment.grid import StackedVectors
from isi.experiment.insert import (
    InsertConfig,
    InsertTask,
    SessionResult,
    finetune,
    initialize,
    run_session,
    with_vectors,
)
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.initializers.api import NovelEntities
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, never_stop
from tests.worlds import NOVEL, World, points_at, world

NEGATIVES = Negatives(mode="sampled", ratio=2, head_pool="unseen")
OPTIMIZER = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=3)


def task_of(of: World, **changes: object) -> InsertTask:
    """Insertion by ES into random vectors, fine-tuned for all epochs."""
    config = InsertConfig("es", {"k": 3}, 0, NEGATIVES, OPTIMIZER, 0.0, [NOVEL.shape[1]])
    joint = {(1, scope): np.full(2, np.nan) for scope in SCOPES}
    points, rows = points_at(of.graph, of.splits), np.insert(of.insert_triples, 0, 1, axis=1)
    theta0 = StackedVectors(of.theta0.model, of.theta0.entity.numpy(), of.theta0.relation.numpy())
    return InsertTask(points, theta0, rows, of.words, joint, replace(config, **changes))  # type: ignore[arg-type]


def stepped(task: InsertTask) -> SessionResult:
    return run_session(task, task.theta0.stack, 1)


def test_the_mask_is_of_each_models_own_insert_triples() -> None:
    told = NovelEntities(
        torch.zeros(2, 3, dtype=torch.long), torch.tensor([[0, 0, 1], [0, 2, 4], [1, 1, 0]]), torch.zeros(1, 1)
    )
    mask = told.mask(6)
    assert mask.dtype == torch.bool
    assert mask.tolist() == [[False, True, False, False, True, False], [True] + [False] * 5]


def test_at_once_it_asks_about_the_novel_entities_what_was_not_told() -> None:
    """Each triple that takes part and touches one; measures count triples, asked about by all three slots."""
    of = world()
    done, triples = stepped(task_of(of)), of.graph.triples.tolist()
    for model in range(2):
        novel = set(NOVEL[model].tolist())
        told = {triple for own, _, triple in of.insert_triples.tolist() if own == model}
        asked = [
            (head, tail)
            for triple, (head, _, tail) in enumerate(triples)
            if of.splits[model, triple] in (TRAIN, VALID, TEST) and triple not in told and {head, tail} & novel
        ]  # fmt: skip
        assert told
        assert int(done.immediate["novel"].queries[model]) == len(asked)
        for place, entity in enumerate(NOVEL[model]):
            assert int(done.by_entity[place].queries[model]) == sum(int(entity) in ends for ends in asked)


def test_what_is_told_of_each_is_packed_to_the_left() -> None:
    of = world()
    task = task_of(of)
    shown = task.context(of.theta0, 1)
    rows = {(model, place): [] for model in range(2) for place in range(3)}  # type: ignore[var-annotated]
    for model, place, triple in of.insert_triples.tolist():
        head, relation, tail = of.graph.triples[triple].tolist()
        is_tail = tail == NOVEL[model, place]
        rows[model, place].append((head if is_tail else tail, relation, is_tail))
    longest = max(map(len, rows.values()))
    assert longest > 1
    for (model, place), expected in rows.items():
        padded = [*((*row, True) for row in expected), *[(0, 0, False, False)] * (longest - len(expected))]
        found = (shown.other, shown.relation, shown.novel_is_tail, shown.observed)
        assert list(zip(*(table[model, place].tolist() for table in found), strict=True)) == padded
    nothing = replace(task, insert_triples=task.insert_triples[:0])
    assert nothing.context(of.theta0, 1).observed.tolist() == [[[False]] * 3] * 2


def trained(task: InsertTask, purpose: str, pool: str) -> Embedding:
    """The same by the parts that it is made of."""
    points, config = task.points, task.config
    data = training_data(points.session(1), purpose, points.keys(), pool, torch.as_tensor(NOVEL))
    return trainer.train(task.theta0.stack, data, config.negatives, config.optimizer, config.root, never_stop)


@pytest.mark.parametrize("pool", ["all", "unseen"])
def test_fine_tuning_draws_for_its_own_purpose_from_the_pool_that_params_name(pool: str) -> None:
    task = task_of(world(), negatives=NEGATIVES.model_copy(update={"head_pool": pool}))
    learned = finetune(task, task.theta0.stack, 1, never_stop).entity
    other = {"all": "unseen", "unseen": "all"}[pool]
    assert torch.equal(learned, trained(task, "fine-tuning", pool).entity)
    assert not torch.equal(learned, trained(task, "fine-tuning", other).entity)
    assert not torch.equal(learned, trained(task, "training", pool).entity)


def test_where_new_rows_go_first_they_are_those_of_the_session() -> None:
    task = task_of(world(), optimizer=OPTIMIZER.model_copy(update={"new_rows_first": 3}))
    done = stepped(task)
    before = with_vectors(task.theta0.stack, torch.as_tensor(NOVEL), done.initial.vectors).entity
    moved = (done.theta.entity != before).any(-1).numpy()
    for model in range(2):
        assert set(np.flatnonzero(moved[model])) == set(NOVEL[model])


def test_an_initializer_that_there_is_not_is_named_by_its_key() -> None:
    task = task_of(world(), initializer="rz")
    with pytest.raises(InputError, match=r"^params\.yaml: initializers\.rz: "):
        initialize(task, task.theta0.stack, 1)
