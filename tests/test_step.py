"""One step of incremental learning: what it measures at once, and on what it learns on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from isi.errors import InputError
from isi.experiment.grid import GridPoints
from isi.experiment.insertion_step import (
    InsertConfig,
    SessionResult,
    finetune,
    initialize,
    run_session,
    with_vectors,
)
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.initializers.api import NovelEntities, context_of
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer
from tests.worlds import NOVEL, World, points_at, world

NEGATIVES = Negatives(mode="sampled", ratio=2, head_pool="unseen")
OPTIMIZER = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=3)


def how_to(points: GridPoints, **changes: object) -> InsertConfig:
    how = InsertConfig(
        "es", {"k": 3}, 0, points.keys(), NEGATIVES, OPTIMIZER, {"all": torch.full((2,), torch.nan)}, True
    )
    return replace(how, **changes)  # type: ignore[arg-type]


def told_of(of: World) -> NovelEntities:
    return NovelEntities(torch.as_tensor(NOVEL), torch.as_tensor(of.insert_triples), torch.as_tensor(of.words))


def on(_epoch: int, _embedding: Embedding, models: Tensor) -> Tensor:
    """Lets no model go."""
    return torch.ones(len(models), dtype=torch.bool)


def stepped(of: World) -> SessionResult:
    points = points_at(of.graph, of.splits)
    return run_session(of.theta0, points.session(0), points.session(1), told_of(of), how_to(points))


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
    done, triples = stepped(of), of.graph.triples.tolist()
    for model in range(2):
        novel = set(NOVEL[model].tolist())
        told = {triple for own, _, triple in of.insert_triples.tolist() if own == model}
        asked = [
            (head, tail)
            for triple, (head, _, tail) in enumerate(triples)
            if of.splits[model, triple] in (TRAIN, VALID, TEST) and triple not in told and {head, tail} & novel
        ]  # fmt: skip
        assert told
        assert int(done.at_once["novel"].queries[model]) == len(asked)
        for place, entity in enumerate(NOVEL[model]):
            assert int(done.own[place].queries[model]) == sum(int(entity) in ends for ends in asked)


def test_what_is_told_of_each_is_packed_to_the_left() -> None:
    of = world()
    points, told = points_at(of.graph, of.splits), told_of(of)
    shown = context_of(of.theta0, points.session(0), told, 0, points.keys())
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
    nothing = NovelEntities(told.novel, told.insert_triples[:0], told.words)
    assert context_of(of.theta0, points.session(0), nothing, 0, points.keys()).observed.tolist() == [[[False]] * 3] * 2


def trained(of: World, how: InsertConfig, purpose: str, pool: str) -> Embedding:
    """The same by the parts that it is made of."""
    points = points_at(of.graph, of.splits)
    data = training_data(points.session(1), purpose, how.keys, pool, torch.as_tensor(NOVEL))
    return trainer.train(of.theta0, data, how.negatives, how.optimizer, how.root, on)


@pytest.mark.parametrize("pool", ["all", "unseen"])
def test_fine_tuning_draws_for_its_own_purpose_from_the_pool_that_params_name(pool: str) -> None:
    of = world()
    points = points_at(of.graph, of.splits)
    how = how_to(points, negatives=NEGATIVES.model_copy(update={"head_pool": pool}))
    learned = finetune(of.theta0, points.session(1), torch.as_tensor(NOVEL), how, on).entity
    other = {"all": "unseen", "unseen": "all"}[pool]
    assert torch.equal(learned, trained(of, how, "fine-tuning", pool).entity)
    assert not torch.equal(learned, trained(of, how, "fine-tuning", other).entity)
    assert not torch.equal(learned, trained(of, how, "training", pool).entity)


def test_where_new_rows_go_first_they_are_those_of_the_session() -> None:
    of = world()
    points = points_at(of.graph, of.splits)
    how = how_to(points, optimizer=OPTIMIZER.model_copy(update={"new_rows_first": 3}))
    done = run_session(of.theta0, points.session(0), points.session(1), told_of(of), how)
    before = with_vectors(of.theta0, torch.as_tensor(NOVEL), done.initial.vectors).entity
    moved = (done.theta.entity != before).any(-1).numpy()
    for model in range(2):
        assert set(np.flatnonzero(moved[model])) == set(NOVEL[model])


def test_an_initializer_that_there_is_not_is_named_by_its_key() -> None:
    of = world()
    points = points_at(of.graph, of.splits)
    with pytest.raises(InputError, match=r"^params\.yaml: initializers\.rz: "):
        initialize(of.theta0, points.session(0), told_of(of), how_to(points, initializer="rz"))
