"""Compiled updates against batches of one observation, against values by hand, and in stacks."""

import subprocess
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

from isi.models.bilinear import ANALOGY, BlockModel
from isi.models.model import Model, make_model
from isi.models.scoring import Distance, Interaction
from isi.models.stack import uniform
from isi.training.batches import Corrupted, Negatives, TrainingData, sample_epoch, training_data
from isi.training.compiled import MEMORY, update
from isi.training.trainer import Optimizer, State, is_compiled, run_epoch, start
from stages.grid import GridPoints
from tests.small_graphs import points_of, random_embedding, random_graph

SAMPLED = Negatives(mode="sampled", ratio=3)
SINGLY = Optimizer(batch_size=1, learning_rate=0.1, weight_decay=1e-3, max_epochs=1)
KINDS = ("analogy", "distmult", "complex")


def small_points(seeds: list[int] | None = None, relations: int = 3) -> GridPoints:
    return points_of(random_graph(13, relations, 80), 2, seeds or [0, 1, 2])


@dataclass(frozen=True)
class Fifth(BlockModel):
    """A user's block model: a fifth of its coordinates are scalars."""

    linear = True
    scalars = 20


BLOCKS: dict[str, Model] = {kind: make_model(kind, {}, kind) for kind in KINDS} | {"fifth": Fifth()}


def begin(points: GridPoints, kind: str = "analogy") -> State:
    relations, model = len(points.graph.relations), BLOCKS[kind]
    return start(uniform(points.session(0).entities, relations, model, 20, 0.3, 0, points.keys()))


def small_data(points: GridPoints) -> TrainingData:
    return training_data(points.session(0), "test", points.keys())


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
        ("fifth", 1e-3, 3),
    ],
)
def test_some_hundred_updates_give_the_numbers_of_batches_of_one(
    kind: str, decay: float, relations: int
) -> None:
    points = small_points(relations=relations)
    data = small_data(points)
    settings = SINGLY.model_copy(update={"weight_decay": decay})
    compiled, plain = begin(points, kind), begin(points, kind)
    for epoch in (1, 2):
        run_epoch(compiled, data, SAMPLED, settings, 0, epoch)
        run_epoch(plain, data, SAMPLED, settings, 0, epoch, compiled=False)
    assert 2 * int(data.counts.sum(1).min()) > 150
    for result, expected in zip(tensors(compiled), tensors(plain), strict=True):
        torch.testing.assert_close(result, expected, rtol=1e-4, atol=2e-5)
    assert not torch.allclose(
        compiled.embedding.entity, begin(points, kind).embedding.entity, atol=0.1
    )


def test_a_step_by_hand() -> None:
    """DistMult with d = 1: f = h · r · t. Entity 3 is in no triple; 2 is a corrupted head twice."""
    entities, relation = [1.0, 2.0, 0.5, 3.0], 0.5
    rows = np.array([[value] for value in [*entities, relation, *[9.0] * MEMORY]], np.float32)
    squares = np.full((5, 1), 4, np.float32)
    ids = [[[0, 4, 1]], [[0]], [[2, 2]], [[]]]  # 4: the relation
    update(rows, squares, 1, 0.1, 0.2, *(np.array(part, np.int32).reshape(1, -1) for part in ids))
    true, tail, head = -1 / (1 + np.exp(1.0)), 1 / (1 + np.exp(-0.5)), 2 / (1 + np.exp(-0.5))
    gradients = {
        0: true * 0.5 * 2 + tail * 2 * 0.5 * 1,  # f(0, 0) = r · 1²
        1: true * 0.5 * 1 + head * 0.5 * 0.5,
        2: head * 0.5 * 2,
        4: true * 1 * 2 + tail * 1 * 1 + head * 0.5 * 2,
    }
    for row, gradient in gradients.items():
        value = [*entities, relation][row]
        step = gradient + 0.2 * value
        assert squares[row, 0] == pytest.approx(4 + step**2, rel=1e-6)
        assert rows[row, 0] == pytest.approx(value - 0.1 * step / (4 + step**2) ** 0.5, rel=1e-6)
    assert rows[3, 0] == 3
    assert squares[3, 0] == 4


def first_alone(counts: Tensor) -> Tensor:
    """One observation of the first triple that has any; shapes: (M, T)."""
    observed = counts > 0
    return (observed & (observed.cumsum(1) == 1)).long()


def triples_of(corrupted: Corrupted, number: int) -> Tensor:
    """An observation and its corrupted triples, shape (N, 3)."""
    one = corrupted.at(number)
    return torch.cat([one.triples, one.negatives()])


def reference(state: State, data: TrainingData, settings: Optimizer, epoch: int) -> list[Tensor]:
    """An epoch in float64, row by row, of a stack of one: both tables, then their squares."""
    (corrupted,) = sample_epoch(data, SAMPLED.ratio, 0, epoch)
    entity, relation, *squares = (table[0].double() for table in tensors(state))
    for number in range(len(corrupted.triples)):
        head, link, tail = triples_of(corrupted, number).T
        tables = [entity.clone().requires_grad_(), relation.clone().requires_grad_()]
        scores = state.embedding.model.score(tables[0][head], tables[1][link], tables[0][tail])
        loss = -logsigmoid(scores[0]) - logsigmoid(-scores[1:]).sum()
        gradients = torch.autograd.grad(loss, tables)
        touched = torch.cat([head, tail]), link
        for place, table in enumerate((entity, relation)):
            for row in touched[place].unique():
                step = gradients[place][row] + settings.weight_decay / 20 * table[row]
                squares[place][row] += step**2
                table[row] -= settings.learning_rate * step / squares[place][row].sqrt()
    return [entity, relation, *squares]


@pytest.mark.parametrize("kind", KINDS)
def test_an_epoch_gives_the_numbers_of_autograd_and_steps_row_by_row(kind: str) -> None:
    points = small_points([0])
    data, settings = small_data(points), SINGLY.model_copy(update={"weight_decay": 2.0})
    state = begin(points, kind)
    expected = reference(state, data, settings, 1)
    run_epoch(state, data, SAMPLED, settings, 0, 1)
    for result, table in zip(tensors(state), expected, strict=True):
        torch.testing.assert_close(result[0].double(), table, rtol=1e-4, atol=2e-5)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_rows_that_no_triple_touches_do_not_move(compiled: bool, seed: int) -> None:
    points = points_of(random_graph(40, 5, 80), 2, [seed])
    data = small_data(points)
    data = replace(data, counts=first_alone(data.counts))
    state, before = begin(points), begin(points)
    (corrupted,) = sample_epoch(data, SAMPLED.ratio, 0, 1)
    assert len(corrupted.triples) == 1
    head, relation, tail = triples_of(corrupted, 0).T
    run_epoch(state, data, SAMPLED, SINGLY, 0, 1, compiled=compiled)
    entities = torch.isin(torch.arange(40), torch.cat([head, tail]))
    relations = torch.isin(torch.arange(5), relation)
    for table, old in zip(tensors(state), tensors(before), strict=True):
        moved = (table != old).any(-1)[0]
        assert torch.equal(moved, entities if len(moved) == 40 else relations)
    assert not entities.all()


def test_equal_epochs_have_equal_bits() -> None:
    points = small_points()
    data, one, other = small_data(points), begin(points), begin(points)
    for state in (one, other):
        run_epoch(state, data, SAMPLED, SINGLY, 0, 1)
    assert same(one, other)


def test_no_observation_is_no_update() -> None:
    points = small_points()
    data = small_data(points)
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
    [(model, True) for model in BLOCKS.values()]
    + [
        (make_model(kind, {"margin": 2.0, "squared": True}, kind), False)
        for kind in ("transe", "rotate")
    ]
    + [(Far(), False)],
)
def test_what_has_other_mathematics_learns_by_batches(model: Model, known: bool) -> None:
    points = small_points([0])
    data = small_data(points)
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
