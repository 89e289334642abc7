"""ANALOGY against numbers by hand, dense matrices and autograd."""

from __future__ import annotations

import pytest
import torch

from isi.embeddings import analogy
from isi.embeddings.stack import Embedding
from tests.graphs import dense, random_embedding

#: Two scalars, 2 and -1, and one block with x = 3, y = 4.
RELATION = torch.tensor([2.0, -1.0, 3.0, 4.0])
HEAD = torch.tensor([1.0, 2.0, 3.0, -1.0])
TAIL = torch.tensor([1.0, 0.5, -1.0, 2.0])


def test_map_by_hand() -> None:
    # 1·2; 2·(-1); 3·3 - (-1)·4 = 13; (-1)·3 + 3·4 = 9
    assert analogy.transform(HEAD, RELATION).tolist() == [2.0, -2.0, 13.0, 9.0]


def test_score_by_hand() -> None:
    # 2·1 + (-2)·0.5 + 13·(-1) + 9·2 = 6
    assert analogy.score(HEAD, RELATION, TAIL).item() == 6.0


def test_inverse_map_by_hand() -> None:
    # 1/2; 0.5/(-1); the block of (3, -4)/25: (-1·3 + 2·4)/25 = 0.2 and (2·3 + 1·4)/25 = 0.4
    mapped = analogy.transform(TAIL, analogy.inverse(RELATION))
    torch.testing.assert_close(mapped, torch.tensor([0.5, -0.5, 0.2, 0.4]))


def test_resultants_by_hand() -> None:
    known = torch.stack([HEAD, TAIL])
    alpha = analogy.resultants(known, RELATION.expand(2, 4), torch.tensor([True, False]))
    torch.testing.assert_close(alpha, torch.tensor([[2.0, -2.0, 13.0, 9.0], [0.5, -0.5, 0.2, 0.4]]))


def test_a_halves_stand_before_b_halves() -> None:
    relation = torch.tensor([1.0, 1, 1, 1, 2, 3, 5, 7])  # blocks (x, y): (2, 5) and (3, 7)
    vector = torch.tensor([0.0, 0, 0, 0, 1, 0, 0, 1])  # blocks (a, b): (1, 0) and (0, 1)
    assert analogy.transform(vector, relation).tolist() == [0, 0, 0, 0, 2, -7, 5, 3]


@pytest.mark.parametrize("dimension", [4, 12, 100])
def test_maps_are_dense_matrices(dimension: int) -> None:
    embedding = random_embedding(1, 2, 1, dimension, seed=dimension)
    head, tail, relation = embedding.entity[0, 0], embedding.entity[0, 1], embedding.relation[0, 0]
    matrix = dense(relation)
    torch.testing.assert_close(analogy.transform(head, relation), head @ matrix)
    torch.testing.assert_close(analogy.transform(head, analogy.transpose(relation)), head @ matrix.T)
    torch.testing.assert_close(analogy.score(head, relation, tail), head @ matrix @ tail)
    inverse = torch.linalg.inv(matrix.double()).float()
    torch.testing.assert_close(analogy.transform(tail, analogy.inverse(relation)), tail @ inverse, rtol=1e-3, atol=1e-3)
    alpha = analogy.resultants(embedding.entity[0], relation.expand(2, dimension), torch.tensor([True, False]))
    torch.testing.assert_close(alpha, torch.stack([head @ matrix, tail @ inverse]), rtol=1e-3, atol=1e-3)


def test_all_ways_to_score_agree() -> None:
    models, entities, relations = 3, 5, 2
    embedding = random_embedding(models, entities, relations, 8)
    table, mapped = analogy.score_all(embedding)
    assert table.shape == (models, relations, entities, entities)
    every = torch.cartesian_prod(torch.arange(entities), torch.arange(relations), torch.arange(entities))
    head, relation, tail = (ids.expand(models, -1) for ids in every.T)
    by_tail = analogy.score_tails(embedding, head, relation)
    by_head = analogy.score_heads(embedding, relation, tail)
    by_relation = analogy.score_relations(embedding, head, tail)
    for model in range(models):
        for query, (h, r, t) in enumerate(every.tolist()):
            entity, matrix = embedding.entity[model], dense(embedding.relation[model, r])
            expected = entity[h] @ matrix @ entity[t]
            for found in (
                analogy.score(entity[h], embedding.relation[model, r], entity[t]),
                table[model, r, h, t],
                by_tail[model, query, t],
                by_head[model, query, h],
                by_relation[model, query, r],
                mapped[model, r, h] @ entity[t],
            ):
                torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


def test_gradient_is_that_of_autograd() -> None:
    embedding = random_embedding(2, 4, 3, 8)
    entity, relation = (table.double().requires_grad_() for table in (embedding.entity, embedding.relation))
    slope = torch.randn(2, 3, 4, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    total = sum(
        slope[model, r, h, t] * (entity[model, h] @ dense(relation[model, r]) @ entity[model, t])
        for model in range(2)
        for r in range(3)
        for h in range(4)
        for t in range(4)
    )
    by_entity, by_relation = torch.autograd.grad(total, (entity, relation))
    detached = Embedding(entity.detach(), relation.detach())
    found = analogy.gradient(detached, analogy.score_all(detached)[1], slope)
    torch.testing.assert_close(found.entity, by_entity)
    torch.testing.assert_close(found.relation, by_relation)


@pytest.mark.parametrize("tiny", [0.0, 1e-30, -1e-30])
def test_inverse_near_zero_is_finite_and_keeps_the_sign(tiny: float) -> None:
    inverse = analogy.inverse(torch.full((4,), tiny))
    assert torch.isfinite(inverse).all()
    assert inverse[:2].sign().tolist() == [-1.0 if tiny < 0 else 1.0] * 2
    vectors = torch.full((4,), 100.0)
    assert torch.isfinite(analogy.transform(vectors, inverse)).all()


def test_clamp_leaves_ordinary_relations_alone() -> None:
    relation = torch.tensor([-2e-3, 5e-3, 3e-3, -4e-3])
    back = analogy.transform(analogy.transform(HEAD, relation), analogy.inverse(relation))
    torch.testing.assert_close(back, HEAD)
