"""The margin of distances whose trainer had none."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.embeddings.stack import Embedding

#: Triples whose scores tell the margin, at most.
ASKED = 1000


def middle(embedding: Embedding, triples: Tensor, margin: float | None) -> float:
    """What makes scores positive for triples and negative for others: less the middle of both means, or as given.

    Args:
        embedding: a stack of one, whose margin is 0.
        triples: that it was trained on; ids, shape (T, 3).
    """
    if margin is not None or embedding.family.linear or not len(triples):
        return margin or 0.0
    head, relation, tail = triples[:: -(-len(triples) // ASKED)].T[:, None]
    with torch.no_grad():
        right = embedding.score(head, relation, tail).mean()
        other_heads = embedding.score(head.roll(1, 1), relation, tail).mean()
        other_tails = embedding.score(head, relation, tail.roll(1, 1)).mean()
    return -(right / 2 + (other_heads + other_tails) / 4).item()
