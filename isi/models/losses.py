"""The losses with which embeddings are trained, as far as they decide what a score means."""

from typing import Literal, get_args

#: ``softmax``: cross-entropy over all entities, or a sample of them; ``margin``: of pairs of
#: triples; ``self-adversarial``: negatives weighted by their scores (Sun et al. 2019).
Loss = Literal["logistic", "softmax", "margin", "self-adversarial"]
LOSSES: tuple[Loss, ...] = get_args(Loss)
