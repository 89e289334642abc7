"""Properties of every registered model; scores of the shipped models by hand,
and their accuracy near zero.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from scipy.stats import kstest
from torch import Tensor

import isi
from isi import config
from isi.config import Option
from isi.errors import InputError
from isi.graph.sessions import TRAIN, Session
from isi.models.model import (
    MODELS,
    Model,
    RelationMapModel,
    make_model,
    register_model,
)
from isi.models.scoring import EPSILON, Distance, padded
from isi.models.stack import select, uniform
from isi.tables import paths
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer
from tests.small_graphs import (
    ANALOGY,
    graph_of,
    points_of,
    random_graph,
)
from tests.small_grid import MODEL_OPTIONS

DIMENSION, RELATIONS = 12, 2


@register_model("stretch")
@dataclass(frozen=True)
class Stretch(RelationMapModel):
    """A user's model whose map has a gradient by autograd: f = ⟨shift(h ⊙ exp(r)), t⟩."""

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return (vectors * relation.exp()).roll(1, -1)

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors.roll(-1, -1) * (-relation).exp()

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors.roll(-1, -1) * relation.exp()


#: Options of the shipped models, independent of params; a user's model takes its options from
#: params.
OPTIONS: dict[str, dict[str, Option]] = {
    "analogy": {},
    "distmult": {},
    "complex": {},
    **MODEL_OPTIONS,
}


def registered() -> dict[str, Model]:
    """All registered models; models with the option ``squared`` also with it set."""
    options = config.read(paths.PARAMS)["models"] | OPTIONS
    every = {name: make_model(name, options.get(name, {}), name) for name in MODELS.names()}
    squares = {
        f"{name} squared": make_model(name, listed | {"squared": True}, name)
        for name, listed in options.items()
        if "squared" in listed
    }
    return every | squares


BATTERY = registered()
over_all = pytest.mark.parametrize("scoring", BATTERY.values(), ids=BATTERY)


@over_all
def test_all_that_are_registered_pass_the_checks(scoring: Model) -> None:
    isi.check_model(scoring)


@over_all
@pytest.mark.parametrize("points", [0, 2**23], ids=["lists", "tables"])
def test_epochs_are_bit_identical_whatever_the_stack(
    scoring: Model, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isi.training.batches.DENSE_LIMIT", points)
    chosen = torch.tensor([2, 0, 3])
    settings = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=1)
    grid = points_of(random_graph(13, RELATIONS, 60), 2, [0, 1, 2, 3])
    start = uniform(grid.session(0).entities, RELATIONS, scoring, DIMENSION, 0.5, 0, grid.keys())
    negatives = Negatives(mode="sampled", ratio=3)
    data = training_data(grid.session(0), "test", grid.keys())
    together, alone = trainer.start(start), trainer.start(select(start, chosen))
    for epoch in (1, 2, 3):
        trainer.run_epoch(together, data, negatives, settings, 0, epoch)
        trainer.run_epoch(alone, select(data, chosen), negatives, settings, 0, epoch)
    for table in ("entity", "relation"):
        assert torch.equal(
            getattr(together.embedding, table)[chosen], getattr(alone.embedding, table)
        )
        assert not torch.equal(getattr(together.embedding, table), getattr(start, table))


@pytest.mark.parametrize(
    ("name", "dimension"), [("analogy", 6), ("analogy", 9), ("complex", 7), ("rotate", 5)]
)
def test_an_impossible_dimension_is_refused_by_name(name: str, dimension: int) -> None:
    with pytest.raises(
        InputError, match=rf"dimension {dimension}: expected a multiple of [24], as \w+ needs"
    ):
        uniform(
            torch.ones(1, 3, dtype=torch.bool),
            2,
            BATTERY[name],
            dimension,
            0.1,
            0,
            torch.zeros(1, 2),
        )


# By hand


def complex_score(head: list[complex], relation: list[complex], tail: list[complex]) -> float:
    return sum((h * r * t.conjugate()).real for h, r, t in zip(head, relation, tail, strict=True))


@pytest.mark.parametrize(
    ("name", "relation", "expected"),
    [
        # scalars 2 and -1, block x = 3, y = 4: 2·1 + (-2)·0.5 + 13·(-1) + 9·2
        ("analogy", [2.0, -1.0, 3.0, 4.0], 6.0),
        # 1·2·1 + 2·(-1)·0.5 + 3·3·(-1) + (-1)·4·2
        ("distmult", [2.0, -1.0, 3.0, 4.0], -16.0),
        # pairs (1, 3), (2, -1) by (2, 3), (-1, 4) with (1, -1), (0.5, 2)
        (
            "complex",
            [2.0, -1.0, 3.0, 4.0],
            complex_score([1 + 3j, 2 - 1j], [2 + 3j, -1 + 4j], [1 - 1j, 0.5 + 2j]),
        ),
        # 4 minus the length of (1 + 2 - 1, 2 - 1 - 0.5, 3 + 3 + 1, -1 + 4 - 2)
        ("transe", [2.0, -1.0, 3.0, 4.0], 4 - math.sqrt(4 + 0.25 + 49 + 1)),
        ("transe squared", [2.0, -1.0, 3.0, 4.0], 4 - 54.25),
        # (1 + 3i) turned by a right angle is -3 + i; (2 - i) by half a turn is -2 + i
        ("rotate", [math.pi / 2, math.pi], 4 - math.sqrt(16 + 4 + 6.25 + 1)),
        ("rotate squared", [math.pi / 2, math.pi], 4 - 27.25),
    ],
)
def test_score_by_hand(name: str, relation: list[float], expected: float) -> None:
    head, tail = torch.tensor([1.0, 2.0, 3.0, -1.0]), torch.tensor([1.0, 0.5, -1.0, 2.0])
    assert BATTERY[name].score(head, torch.tensor(relation), tail).item() == pytest.approx(
        expected, rel=1e-5
    )


@pytest.mark.parametrize(
    ("name", "relation", "there", "back"),
    [
        # 1·2; 2·(-1); 3·3 - (-1)·4; (-1)·3 + 3·4. Back: 1/2; 2/(-1); the block of (3, -4)/25
        ("analogy", [2.0, -1.0, 3.0, 4.0], [2, -2, 13, 9], [0.5, -2, 0.2, -0.6]),
        ("distmult", [2.0, -1.0, 4.0, 5.0], [2, -2, 12, -5], [0.5, -2, 0.75, -0.2]),
        # (1 + 3i)·2i = -6 + 2i, (2 - i)·i = 1 + 2i; over 2i: 1.5 - 0.5i, over i: -1 - 2i
        ("complex", [0.0, 0.0, 2.0, 1.0], [-6, 1, 2, 2], [1.5, -1, -0.5, -2]),
        ("transe", [2.0, -1.0, 3.0, 4.0], [3, 1, 6, 3], [-1, 3, 0, -5]),
        ("rotate", [math.pi / 2, math.pi], [-3, -2, 1, 1], [3, -2, -1, 1]),
    ],
)
def test_maps_by_hand(
    name: str, relation: list[float], there: list[float], back: list[float]
) -> None:
    vector, row = torch.tensor([1.0, 2.0, 3.0, -1.0]), torch.tensor(relation)
    torch.testing.assert_close(
        BATTERY[name].transform(vector, row), torch.tensor(there, dtype=torch.float32)
    )
    torch.testing.assert_close(
        BATTERY[name].inverse(vector, row), torch.tensor(back, dtype=torch.float32)
    )


@pytest.mark.parametrize("tiny", [0.0, 1e-30, -1e-30])
def test_inverse_near_zero_is_finite_and_keeps_the_sign(tiny: float) -> None:
    there = ANALOGY.inverse(torch.tensor([1.0, 1.0, 100.0, 100.0]), torch.full((4,), tiny))
    assert torch.isfinite(there).all()
    assert there[:2].sign().tolist() == [-1.0 if tiny < 0 else 1.0] * 2


@pytest.mark.parametrize("squared", [False, True])
def test_a_distance_of_nothing_has_a_finite_gradient(squared: bool) -> None:
    interaction, points = Distance(2.0, squared), torch.full((1, 2, 4), 0.3)
    scores, backward = interaction.pairs(points, points)
    nearest = 2 - (EPSILON if squared else math.sqrt(EPSILON))
    assert scores.flatten().tolist() == pytest.approx([nearest] * 4, abs=1e-3)
    for table in backward(torch.ones(1, 2, 2)):
        assert table.abs().max() < 1e-3
    listed, backward = interaction.rows(points[0], points[0])
    assert listed.tolist() == pytest.approx([nearest] * 2)
    for table in backward(torch.ones(2)):
        assert table.abs().max() == 0


def test_rotate_starts_with_phases_all_around() -> None:
    start = uniform(
        torch.ones(2, 5, dtype=torch.bool),
        200,
        BATTERY["rotate"],
        8,
        0.01,
        0,
        torch.zeros(2, 2).long(),
    )
    assert start.relation.shape == (2, 200, 4)
    assert start.entity.abs().max() <= 0.01
    assert 3.1 < start.relation.abs().max() <= math.pi


def test_each_model_of_a_stack_starts_from_its_own_uniform_numbers() -> None:
    known = torch.ones(2, 50, dtype=torch.bool)
    start = uniform(known, 50, ANALOGY, 8, 0.01, 0, torch.tensor([[3, 0], [3, 1]]))
    for table in (start.entity, start.relation):
        assert not (table[0] == table[1]).any()
        for values in table:
            assert kstest(values.flatten(), "uniform", (-0.01, 0.02)).pvalue > 0.01
    alone = uniform(known[1:], 50, ANALOGY, 8, 0.01, 0, torch.tensor([[3, 1]]))
    assert torch.equal(alone.entity[0], start.entity[1])


def test_numbers_apart_from_their_neighbours_are_bit_identical() -> None:
    values = torch.linspace(-7, 7, 1003)
    functions: list[Callable[[Tensor], Tensor]] = [torch.sigmoid, torch.cos, torch.sin]
    for function in functions:
        whole = padded(function, values)
        assert all(
            torch.equal(padded(function, values[first:]), whole[first:]) for first in range(40)
        )
        assert torch.equal(padded(function, values[:1000].view(10, 100)).flatten(), whole[:1000])


def test_vectors_lie_on_the_sphere_or_in_the_ball() -> None:
    vectors = torch.tensor([[[3.0, 4.0], [0.3, 0.4], [0.0, 0.0]]])
    expected = {
        "none": vectors,
        "sphere": torch.tensor([[[0.6, 0.8], [0.6, 0.8], [0.0, 0.0]]]),
        "ball": torch.tensor([[[0.6, 0.8], [0.3, 0.4], [0.0, 0.0]]]),
    }
    for constraint, kept in expected.items():
        model = make_model("complex", {"constraint": constraint}, "models.complex")
        torch.testing.assert_close(model.constrain(vectors), kept)
        assert model.is_free == (constraint == "none")
        assert not trainer.is_compiled(model, 1) or model.is_free
    with pytest.raises(InputError, match="constraint"):
        make_model("distmult", {"constraint": "cube"}, "models.distmult")


def test_training_keeps_vectors_under_the_constraint_and_others_as_they_are() -> None:
    counts = {(e, e % RELATIONS, (e + 1) % 7): 1 for e in range(7)}
    graph, keys = graph_of(counts, 8, RELATIONS), torch.tensor([[0]])
    known = torch.arange(8)[None] < 7
    session = Session(graph, known, torch.full((1, 7), TRAIN, dtype=torch.int8))
    model = make_model("transe", {"margin": 2.0, "squared": False, "constraint": "sphere"}, "")
    theta = uniform(torch.ones(1, 8, dtype=torch.bool), RELATIONS, model, DIMENSION, 0.3, 0, keys)
    data = training_data(session, "training", keys)
    settings = Optimizer(batch_size=5, learning_rate=0.1, weight_decay=0.0, max_epochs=2)
    negatives = Negatives(mode="sampled", ratio=2)
    trained = trainer.train(theta, data, negatives, settings, 0)
    lengths = trained.entity[0].norm(dim=-1)
    torch.testing.assert_close(lengths[:7], torch.ones(7))
    assert torch.equal(trained.entity[0, 7], theta.entity[0, 7])
