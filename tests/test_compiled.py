"""Compiled updates against batches of one observation, against values by hand, and in stacks."""

import subprocess
import sys
from dataclasses import dataclass, replace
from unittest.mock import patch

import pytest
import torch

from isi.experiment.grid import GridPoints
from isi.models.bilinear import ANALOGY
from isi.models.model import Model, make_model
from isi.models.scoring import Distance, Interaction
from isi.models.stack import uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
from isi.training.trainer import Optimizer, State, is_compiled, run_epoch, start
from tests.small_graphs import points_of, random_embedding, random_graph

SAMPLED = Negatives(mode="sampled", ratio=3)
SINGLY = Optimizer(batch_size=1, learning_rate=0.1, weight_decay=1e-3, max_epochs=1)
KINDS = ("analogy", "distmult", "complex")


def small_points(seeds: list[int] | None = None, relations: int = 3) -> GridPoints:
    return points_of(random_graph(13, relations, 80), 2, seeds or [0, 1, 2])


def begin(points: GridPoints, kind: str = "analogy") -> State:
    relations, model = len(points.graph.relations), make_model(kind, {}, kind)
    return start(uniform(points.session(0).entities, relations, model, 20, 0.3, 0, points.keys()))


def by_batches(state: State, data: TrainingData, settings: Optimizer, epoch: int) -> None:
    """Run an epoch without compilation."""
    with patch.object(trainer, "is_compiled", return_value=False):
        run_epoch(state, data, SAMPLED, settings, 0, epoch)


def tensors(state: State) -> list[torch.Tensor]:
    return [
        table
        for stack in (state.embedding, state.squares)
        for table in (stack.entity, stack.relation)
    ]


def same(one: State, other: State) -> bool:
    return all(torch.equal(a, b) for a, b in zip(tensors(one), tensors(other), strict=True))


@pytest.mark.parametrize(
    ("kind", "decay", "relations"),
    [
        ("analogy", 0.0, 3),
        ("analogy", 0.1, 3),
        ("distmult", 1e-3, 3),
        ("complex", 1e-3, 3),
        ("analogy", 1e-3, 1),
        ("analogy", 1e-3, 2),
    ],
)
def test_some_hundred_updates_give_the_numbers_of_batches_of_one(
    kind: str, decay: float, relations: int
) -> None:
    points = small_points(relations=relations)
    data = training_data(points.session(0), "test", points.keys())
    settings = SINGLY.model_copy(update={"weight_decay": decay})
    compiled, plain = begin(points, kind), begin(points, kind)
    for epoch in (1, 2):
        run_epoch(compiled, data, SAMPLED, settings, 0, epoch)
        by_batches(plain, data, settings, epoch)
    assert 2 * int(data.counts.sum(1).min()) > 150
    for result, expected in zip(tensors(compiled), tensors(plain), strict=True):
        torch.testing.assert_close(result, expected, rtol=1e-4, atol=2e-5)
    assert not torch.allclose(
        compiled.embedding.entity, begin(points, kind).embedding.entity, atol=0.1
    )


def test_no_observation_is_no_update() -> None:
    points = small_points()
    data = training_data(points.session(0), "test", points.keys())
    counts = data.counts.clone()
    counts[1] = 0
    state, before = begin(points), begin(points)
    run_epoch(state, replace(data, counts=counts), SAMPLED, SINGLY, 0, 1)
    changed, members = state.embedding.entity != before.embedding.entity, points.session(0).entities
    assert changed.all(-1).tolist() == (members & torch.tensor([[True], [False], [True]])).tolist()
    assert not changed[~members].any()
    run_epoch(before, replace(data, counts=counts * 0), SAMPLED, SINGLY, 0, 1)
    assert same(before, begin(points))


@dataclass(frozen=True)
class Far(ANALOGY):
    """A user's model with another interaction."""

    @property
    def interaction(self) -> Interaction:
        return Distance(1.0, squared=True)


@pytest.mark.parametrize(
    ("model", "known"),
    [(make_model(kind, {}, kind), True) for kind in KINDS]
    + [
        (make_model(kind, {"margin": 2.0, "squared": True}, kind), False)
        for kind in ("transe", "rotate")
    ]
    + [(Far(), False)],
)
def test_what_has_other_mathematics_learns_by_batches(model: Model, known: bool) -> None:
    points = small_points([0])
    data = training_data(points.session(0), "test", points.keys())
    embedding = random_embedding(1, 13, 3, 20, model=model)
    assert is_compiled(model, 1) is known
    assert not is_compiled(model, 2)
    state = start(embedding)
    run_epoch(state, data, SAMPLED, SINGLY, 0, 1)
    assert not torch.equal(state.embedding.entity, embedding.entity)


def test_numba_is_imported_where_it_is_needed_alone_and_then_before_workers_are_forked() -> None:
    """The import takes a second, and few stages need it."""
    lines = (
        "import sys, stages.insert, stages.train_theta0",
        "from isi.models.model import make_model",
        "from isi.training.trainer import compile_ahead",
        "compile_ahead(make_model('analogy', {}, ''), 2048)",
        "compile_ahead(make_model('rotate', {'margin': 1.0, 'squared': True}, ''), 1)",
        "assert 'numba' not in sys.modules",
        "compile_ahead(make_model('analogy', {}, ''), 1)",
        "assert sys.modules['isi.training.compiled'].update.nopython_signatures",
    )
    subprocess.run([sys.executable, "-c", "; ".join(lines)], check=True)
