"""An update for each observation, one after the other: what batches of one do, some hundred times as fast.

For families whose relations are scalars and blocks, with drawn negatives, on the CPU; all else goes through batches.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from isi.models.bilinear import Blocks
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.training.batches import Corrupted, Negatives, TrainingData, are_drawn, in_turn

#: What ``compiled`` knows of a family; one that has its own of any is not its.
_MATHEMATICS = ("maps", "pull_maps", "map", "transform", "interaction", "score", "scores")


def can_compile(embedding: Embedding, data: TrainingData, negatives: Negatives, batch_size: int) -> bool:
    """Whether an epoch can run one by one."""
    drawn, device = are_drawn(negatives, data.session.graph), embedding.entity.device
    return batch_size == 1 and drawn and device.type == "cpu" and is_block_model(embedding.model)


def is_block_model(family: Model) -> bool:
    """Whether a family has no mathematics beside that of ``Blocks``."""
    return isinstance(family, Blocks) and all(
        getattr(type(family), name) is getattr(Blocks, name) for name in _MATHEMATICS
    )


def compile_ahead(family: Model, batch_size: int) -> None:
    """Have the machine code ready, so that forked workers share it (compiled once, then read from a cache)."""
    if batch_size == 1 and is_block_model(family):
        import isi.training.compiled  # noqa: F401


def run_compiled(
    embedding: Embedding, squares: Embedding, data: TrainingData, ratio: int, rate: float, decay: float,
    root: int, epoch: int,
) -> None:  # fmt: skip
    """One pass over all observations of each model, in place.

    Args:
        squares: Adagrad's accumulators.
        ratio: corrupted tails, heads and relations for each observation.
        rate, decay: learning rate and weight decay.
    """
    from isi.training.compiled import update  # takes a second

    scalars = cast(Blocks, embedding.model).first_block(embedding.entity.shape[-1])
    for model, corrupted in enumerate(in_turn(data, ratio, root, epoch)):
        tables, sums = (
            (stack.entity[model].numpy(), stack.relation[model].numpy()) for stack in (embedding, squares)
        )  # fmt: skip
        update(tables, sums, scalars, np.float32(rate), np.float32(decay), *_ids(corrupted))


def _ids(corrupted: Corrupted) -> list[np.ndarray]:
    """Triples, and other tails, heads and relations: none where there is but one relation; int32."""
    ids = [part.numpy().astype(np.int32) for part in (corrupted.triples, *corrupted.others)]
    return ids if len(ids) == 4 else [*ids, ids[1][:, :0].copy()]
