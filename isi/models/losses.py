"""The losses with which embeddings are trained: they decide what a score means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor
from torch.nn.functional import relu, softplus

#: ``softmax``: cross-entropy over all entities, or a sample of them; ``margin``: of pairs of
#: triples; ``self-adversarial``: negatives weighted by their scores (Sun et al. 2019).
Loss = Literal["logistic", "softmax", "margin", "self-adversarial"]
LOSSES: tuple[Loss, ...] = get_args(Loss)


@dataclass(frozen=True)
class TrainingLoss:
    """A loss of training with its settings: that of a query is a sum over its right answer and its
    N wrong ones.

    PyKEEN's means over a batch differ by a factor: ``SoftplusLoss`` (``logistic``) is over all
    answers, 1 / (1 + N) of this one; ``NSSALoss`` (``self-adversarial``) over its two halves, 1 / 2
    of this one. ``MarginRankingLoss`` and ``CrossEntropyLoss`` are the same.

    Example:
        >>> import torch
        >>> loss = TrainingLoss("margin", margin=2.0)
        >>> loss.of_wrong(torch.tensor([3.0]), torch.tensor([[1.5, 0.0]]))
        tensor([[0.2500, 0.0000]])
    """

    name: Loss = "logistic"
    #: ``margin``: least difference of the scores of right and wrong answers; ``logistic`` and
    #: ``self-adversarial``: what is added to a score
    margin: float = 0.0
    #: of the weights of ``self-adversarial``: softmax(temperature · score)
    temperature: float = 1.0

    def of_right(self, right: Tensor) -> Tensor:
        """What right answers lose by themselves, by their scores; shapes (B,)."""
        if self.name == "margin":
            return torch.zeros_like(right)
        return softplus(-(right + self.margin))

    def of_wrong(self, right: Tensor, wrong: Tensor, others: Tensor | None = None) -> Tensor:
        """What N wrong answers add to a loss of each query, by scores of right, (B,), and wrong
        answers, (B, N), of which those with -inf do not count; shape (B, N).

        ``others``: (B, K); each wrong answer is then the only one beside these K.
        """
        number = wrong.shape[1] if others is None else 1 + others.shape[1]
        if self.name == "margin":
            return relu(self.margin + wrong - right[:, None]) / number
        losses = softplus(wrong + self.margin)
        if self.name == "logistic":
            return losses
        heat = self.temperature * wrong.detach()
        if others is None:
            # 0 instead of 0 / 0 where no answer counts
            return torch.softmax(heat, 1).nan_to_num() * losses
        rest = (self.temperature * others.detach()).logsumexp(1, keepdim=True)
        return torch.sigmoid(heat - rest) * losses


def loss_named(loss: Loss | TrainingLoss) -> TrainingLoss:
    """A loss of training; of a name, with its usual settings."""
    if isinstance(loss, TrainingLoss):
        return loss
    return TrainingLoss(loss, margin=1.0 if loss == "margin" else 0.0)
