"""What each model that ships scores and where its maps lead, by hand; and their numbers near zero."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from isi.models.bilinear import BlockModel
from isi.models.model import make_model
from isi.models.scoring import EPSILON, Distance, padded
from isi.models.stack import uniform
from tests.small_graphs import ANALOGY, dense, random_embedding

DIMENSION = 12
SHIPPED = {name: make_model(name, {}, name) for name in ("analogy", "distmult", "complex")} | {
    f"{name}{' squared' * squared}": make_model(name, {"margin": 4.0, "squared": squared}, name)
    for name in ("transe", "rotate")
    for squared in (False, True)
}


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
        ("complex", [2.0, -1.0, 3.0, 4.0], complex_score([1 + 3j, 2 - 1j], [2 + 3j, -1 + 4j], [1 - 1j, 0.5 + 2j])),
        # 4 less the length of (1 + 2 - 1, 2 - 1 - 0.5, 3 + 3 + 1, -1 + 4 - 2)
        ("transe", [2.0, -1.0, 3.0, 4.0], 4 - math.sqrt(4 + 0.25 + 49 + 1)),
        ("transe squared", [2.0, -1.0, 3.0, 4.0], 4 - 54.25),
        # (1 + 3i) turned by a right angle is -3 + i; (2 - i) by half a turn is -2 + i
        ("rotate", [math.pi / 2, math.pi], 4 - math.sqrt(16 + 4 + 6.25 + 1)),
        ("rotate squared", [math.pi / 2, math.pi], 4 - 27.25),
    ],
)
def test_score_by_hand(name: str, relation: list[float], expected: float) -> None:
    head, tail = torch.tensor([1.0, 2.0, 3.0, -1.0]), torch.tensor([1.0, 0.5, -1.0, 2.0])
    assert SHIPPED[name].score(head, torch.tensor(relation), tail).item() == pytest.approx(expected, rel=1e-5)


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
def test_maps_by_hand(name: str, relation: list[float], there: list[float], back: list[float]) -> None:
    vector, row = torch.tensor([1.0, 2.0, 3.0, -1.0]), torch.tensor(relation)
    torch.testing.assert_close(SHIPPED[name].transform(vector, row), torch.tensor(there, dtype=torch.float32))
    torch.testing.assert_close(SHIPPED[name].inverse(vector, row), torch.tensor(back, dtype=torch.float32))


def test_rotate_turns_each_pair_as_complex_numbers_do() -> None:
    embedding = random_embedding(1, 1, 1, DIMENSION, model=SHIPPED["rotate"])
    real, imaginary = embedding.entity[0, 0].chunk(2)
    turned = [
        complex(a, b) * cmath.exp(1j * phase)
        for a, b, phase in zip(real.tolist(), imaginary.tolist(), embedding.relation[0, 0].tolist(), strict=True)
    ]
    expected = torch.tensor([*(z.real for z in turned), *(z.imag for z in turned)])
    torch.testing.assert_close(SHIPPED["rotate"].transform(embedding.entity[0, 0], embedding.relation[0, 0]), expected)


def test_rotate_starts_with_phases_all_around() -> None:
    start = uniform(torch.ones(2, 5, dtype=torch.bool), 200, SHIPPED["rotate"], 8, 0.01, 0, torch.zeros(2, 2).long())
    assert start.relation.shape == (2, 200, 4)
    assert start.entity.abs().max() <= 0.01
    assert 3.1 < start.relation.abs().max() <= math.pi


def test_a_halves_stand_before_b_halves() -> None:
    relation = torch.tensor([1.0, 1, 1, 1, 2, 3, 5, 7])  # blocks (x, y): (2, 5) and (3, 7)
    vector = torch.tensor([0.0, 0, 0, 0, 1, 0, 0, 1])  # blocks (a, b): (1, 0) and (0, 1)
    assert ANALOGY.transform(vector, relation).tolist() == [0, 0, 0, 0, 2, -7, 5, 3]


@pytest.mark.parametrize("dimension", [4, 12, 100])
def test_maps_of_analogy_are_dense_matrices(dimension: int) -> None:
    embedding = random_embedding(1, 2, 1, dimension, seed=dimension)
    head, tail, relation = embedding.entity[0, 0], embedding.entity[0, 1], embedding.relation[0, 0]
    matrix = dense(relation)
    assert isinstance(ANALOGY, BlockModel)
    torch.testing.assert_close(ANALOGY.transform(head, relation), head @ matrix)
    torch.testing.assert_close(ANALOGY.transform_tail(head, relation), head @ matrix.T)
    torch.testing.assert_close(ANALOGY.score(head, relation, tail), head @ matrix @ tail)
    inverse = torch.linalg.inv(matrix.double()).float()
    torch.testing.assert_close(ANALOGY.inverse(tail, relation), tail @ inverse, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("tiny", [0.0, 1e-30, -1e-30])
def test_inverse_near_zero_is_finite_and_keeps_the_sign(tiny: float) -> None:
    there = ANALOGY.inverse(torch.tensor([1.0, 1.0, 100.0, 100.0]), torch.full((4,), tiny))
    assert torch.isfinite(there).all()
    assert there[:2].sign().tolist() == [-1.0 if tiny < 0 else 1.0] * 2


def test_clamp_leaves_ordinary_relations_alone() -> None:
    relation, vector = torch.tensor([-2e-3, 5e-3, 3e-3, -4e-3]), torch.tensor([1.0, 2.0, 3.0, -1.0])
    torch.testing.assert_close(ANALOGY.inverse(ANALOGY.transform(vector, relation), relation), vector)


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


def test_numbers_apart_from_their_neighbours_are_bit_identical() -> None:
    values = torch.linspace(-7, 7, 1003)
    functions: list[Callable[[Tensor], Tensor]] = [torch.sigmoid, torch.cos, torch.sin]
    for function in functions:
        whole = padded(function, values)
        assert all(torch.equal(padded(function, values[first:]), whole[first:]) for first in range(40))
        assert torch.equal(padded(function, values[:1000].view(10, 100)).flatten(), whole[:1000])
