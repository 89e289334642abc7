"""The gradient of a batch's loss against autograd, in both forms."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

from isi.models.stack import Embedding, select
from isi.training.batches import (
    DenseBatch,
    ListBatch,
    count_negatives,
    count_positives,
    sample_batch,
    shuffle_into_batches,
    training_data,
)
from isi.training.trainer import loss_gradient
from tests.small_graphs import ANALOGY, dense, points_of, random_embedding, random_graph


def loss(entity: Tensor, relation: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    """Σ -log σ(y · f), written out."""
    maps = torch.stack([torch.stack([dense(row) for row in model]) for model in relation])
    scores = torch.einsum("mhd,mrde,mte->mrht", entity, maps, entity)
    return -(positives * logsigmoid(scores) + negatives * logsigmoid(-scores)).sum()


def test_loss_gradient_is_that_of_autograd() -> None:
    embedding = random_embedding(2, 4, 3, 8)
    entity, relation = (table.double().requires_grad_() for table in (embedding.entity, embedding.relation))
    generator = torch.Generator().manual_seed(3)
    positives, negatives = (torch.randint(4, (2, 3, 4, 4), generator=generator).double() for _ in range(2))
    by_entity, by_relation = torch.autograd.grad(loss(entity, relation, positives, negatives), (entity, relation))
    found = loss_gradient(Embedding(entity.detach(), relation.detach(), ANALOGY), DenseBatch(positives, negatives))
    torch.testing.assert_close(found.entity, by_entity)
    torch.testing.assert_close(found.relation, by_relation)


def test_a_batch_has_the_same_gradient_as_lists_and_as_tables() -> None:
    points = points_of(random_graph(13, 3, 80), 2, [0, 1, 2, 3])
    data, embedding = training_data(points.session(0), "test", points.keys(), "unseen"), random_embedding(4, 13, 3, 12)
    dealt = shuffle_into_batches(data, 0, 1, 40)[1]
    lists = sample_batch(data, dealt, 3, 0, 1, 1)
    assert isinstance(lists, ListBatch)
    tables = DenseBatch(count_positives(data, dealt), count_negatives(data, lists))
    one, other = (loss_gradient(embedding, batch) for batch in (lists, tables))
    torch.testing.assert_close(one.entity, other.entity, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(one.relation, other.relation, rtol=1e-4, atol=1e-5)
    assert one.entity.abs().max() > 0.1


@pytest.mark.parametrize("entities", [11, 12, 13, 30])
def test_loss_gradient_is_bit_identical_whatever_the_stack(entities: int) -> None:
    models, relations = 8, 3
    embedding = random_embedding(models, entities, relations, 12)
    counts = torch.randint(4, (2, models, relations, entities, entities), generator=torch.Generator().manual_seed(1))
    positives, negatives = counts.float()
    together = loss_gradient(embedding, DenseBatch(positives, negatives))
    for height in (1, 3):
        for some in torch.arange(models).split(height):
            alone = loss_gradient(select(embedding, some), DenseBatch(positives[some], negatives[some]))
            assert torch.equal(together.entity[some], alone.entity)
            assert torch.equal(together.relation[some], alone.relation)
