"""One session of incremental learning: the measures right after insertion,
and the data of fine-tuning.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from isi.experiment.grid import GridPoints
from isi.experiment.insert import (
    InsertConfig,
    finetune,
)
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, never_stop
from tests.small_insertion import NOVEL, points_at, world

NEGATIVES = Negatives(mode="sampled", ratio=2, head_pool="unseen")
OPTIMIZER = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=3)
#: Insertion by ES into random vectors, fine-tuned for all epochs.
CONFIG = InsertConfig("es", {"k": 3}, 0, NEGATIVES, OPTIMIZER, 0.0, [NOVEL.shape[1]])
WORLD = world()
POINTS: GridPoints = replace(
    points_at(WORLD.graph, WORLD.splits),
    insert_triples=np.insert(WORLD.insert_triples, 0, 1, axis=1),
)


def test_the_mask_is_of_each_models_own_insert_triples() -> None:
    rows = np.array([[1, 0, 0, 1], [1, 0, 2, 4], [1, 1, 1, 0], [2, 0, 0, 3]])
    points = replace(POINTS, splits=np.zeros((2, 6), dtype=np.int8), insert_triples=rows)
    expected = [[False, True, False, False, True, False], [True] + [False] * 5]
    assert points.insert_mask(1).tolist() == expected


def trained(purpose: str, pool: str) -> Embedding:
    """Θ¹ from a direct call of ``trainer.train``, with a purpose and a head pool."""
    data = training_data(POINTS.session(1), purpose, POINTS.keys(), pool)
    return trainer.train(WORLD.theta0, data, NEGATIVES, OPTIMIZER, 0, never_stop)


@pytest.mark.parametrize("pool", ["all", "unseen"])
def test_fine_tuning_draws_for_its_own_purpose_from_the_pool_that_params_name(pool: str) -> None:
    config = replace(CONFIG, negatives=NEGATIVES.model_copy(update={"head_pool": pool}))
    finetuned = finetune(POINTS, WORLD.theta0, config, never_stop).entity
    other = {"all": "unseen", "unseen": "all"}[pool]
    assert torch.equal(finetuned, trained("fine-tuning", pool).entity)
    assert not torch.equal(finetuned, trained("fine-tuning", other).entity)
    assert not torch.equal(finetuned, trained("training", pool).entity)
