"""The scale of an embedding's scores: how a score becomes the log odds of its triple.

The objective of MAP (``isi.initializers.newton``) weighs facts against corrupted triples by log
odds. With logistic loss a score is the log odds; other losses leave the slope and the border open,
and both are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.platt import fit_platt
from isi.graph.graph import HEAD, TAIL
from isi.models.losses import Loss, TrainingLoss, loss_named
from isi.models.stack import Embedding
from isi.random import stream

#: Maximum number of known triples, evenly spaced by row, to which a scale is fitted.
TRIPLES = 2**12


@dataclass(frozen=True)
class Scale:
    """Log odds of a triple = slope · score + offset, by the loss of training.

    Example:
        >>> Scale().slope, Scale().offset
        (1.0, 0.0)
    """

    training: TrainingLoss = field(default_factory=TrainingLoss)
    slope: float = 1.0
    offset: float = 0.0


LOGISTIC = Scale()  #: The scale of the pipeline's training.


def fit_scale(theta: Embedding, triples: Tensor, loss: Loss | TrainingLoss) -> Scale:
    """The scale of one embedding that was trained with a loss on ``triples``, (T, 3).

    Each triple is corrupted twice, by another head and by another tail. Known triples and
    corruptions weigh the same.
    """
    training = loss_named(loss)
    if training == LOGISTIC.training or len(triples) < 2:
        return Scale(training)  # nothing to fit, or nothing to fit it to
    right, wrong = _known_and_corrupted(theta, triples)
    scores = torch.cat([right.repeat(2), wrong])  # so that both sides weigh the same
    curve = fit_platt(scores.numpy(), np.arange(len(scores)) < 2 * len(right))
    return Scale(training, curve.slope, curve.offset)


def _known_and_corrupted(theta: Embedding, triples: Tensor) -> tuple[Tensor, Tensor]:
    """Scores of known triples, (T,), and of their corruptions, (2T,): with a random head, then
    with a random tail, perhaps the true one, as training and MAP corrupt them.
    """
    entities = theta.entity.shape[1]
    chosen = triples[:: -(-len(triples) // TRIPLES)]
    other = stream(0, "corrupted triples of a scale").integers(entities, size=2 * len(chosen))
    ends = torch.from_numpy(other)
    corrupted = chosen.repeat(2, 1)
    corrupted[: len(chosen), HEAD] = ends[: len(chosen)]
    corrupted[len(chosen) :, TAIL] = ends[len(chosen) :]
    scores = theta.score(*torch.cat([chosen, corrupted]).T[:, None])[0].double()
    return scores[: len(chosen)], scores[len(chosen) :]
