"""One session of incremental learning: the measures right after insertion,
and the data of fine-tuning.
"""

from dataclasses import replace

import numpy as np
import torch

from isi.evaluation.query_sets import CONVERGING
from isi.experiment.grid import GridPoints
from isi.experiment.insert import (
    InsertConfig,
    finetune,
    insert_sessions,
    with_vectors,
)
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, never_stop
from tests.small_insertion import NOVEL, points_at, world

NEGATIVES = Negatives(mode="sampled", ratio=2)
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


def trained(purpose: str) -> Embedding:
    """Θ¹ from a direct call of ``trainer.train``, with a purpose."""
    data = training_data(POINTS.session(1), purpose, POINTS.keys(), torch.as_tensor(NOVEL))
    return trainer.train(WORLD.theta0, data, NEGATIVES, OPTIMIZER, 0, never_stop)


def test_fine_tuning_draws_for_its_own_purpose() -> None:
    finetuned = finetune(POINTS, WORLD.theta0, CONFIG, never_stop).entity
    assert torch.equal(finetuned, trained("fine-tuning").entity)
    assert not torch.equal(finetuned, trained("training").entity)


def test_where_new_rows_go_first_they_are_those_of_the_session() -> None:
    joint, config = (
        {(1, scope): np.full(2, np.nan) for scope in CONVERGING},
        CONFIG.training(new_rows_first=3),
    )
    ((theta, result),) = insert_sessions(POINTS, WORLD.theta0, WORLD.words, joint, config)
    before = with_vectors(
        WORLD.theta0, torch.as_tensor(NOVEL), torch.from_numpy(result.vectors)
    ).entity
    moved = (theta.entity != before).any(-1).numpy()
    for model in range(2):
        assert set(np.flatnonzero(moved[model])) == set(NOVEL[model])
