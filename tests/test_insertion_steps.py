"""One session of incremental learning: the measures right after insertion,
and the data of fine-tuning.
"""

from dataclasses import replace

import numpy as np
import torch

from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, never_stop
from stages.insert import InsertConfig, finetune
from tests.small_insertion import points_at, world

NEGATIVES = Negatives(mode="sampled", ratio=2)
OPTIMIZER = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=3)
CONFIG = InsertConfig("es", {"k": 3}, 0, NEGATIVES, OPTIMIZER, 0.0)
WORLD = world()
POINTS = replace(points_at(WORLD.graph, WORLD.splits), insert_triples=WORLD.insert_triples)


def test_the_mask_is_of_each_models_own_insert_triples() -> None:
    rows = np.array([[0, 0, 1], [0, 2, 4], [1, 1, 0]])
    points = replace(POINTS, splits=np.zeros((2, 6), dtype=np.int8), insert_triples=rows)
    expected = [[False, True, False, False, True, False], [True] + [False] * 5]
    assert points.insert_mask.tolist() == expected


def trained(purpose: str) -> Embedding:
    """Θ¹ from a direct call of ``trainer.train``, with a purpose."""
    data = training_data(POINTS.session(1), purpose, POINTS.keys())
    return trainer.train(WORLD.theta0, data, NEGATIVES, OPTIMIZER, 0, never_stop)


def test_fine_tuning_draws_for_its_own_purpose() -> None:
    finetuned = finetune(POINTS, WORLD.theta0, CONFIG, never_stop).entity
    assert torch.equal(finetuned, trained("fine-tuning").entity)
    assert not torch.equal(finetuned, trained("training").entity)
