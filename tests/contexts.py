"""What an initializer sees of one model, from plain lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from isi.initializers.api import InitContext
from isi.models.model import Model
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, random_embedding

ENTITIES, RELATIONS, DIMENSION = 12, 3, 8
#: One known end, the relation, and whether the novel entity is the tail.
Seen = tuple[int, int, bool]


def insertion(
    theta0: Embedding, novel: Sequence[int], seen: Sequence[Sequence[Seen]], words: Tensor, kinds: Sequence[int]
) -> InitContext:
    """Of one model, whose rows of novel entities are made zero; all that are not novel are known and trained on."""
    known = torch.ones(1, len(kinds), dtype=torch.bool)
    known[0, list(novel)] = False
    longest = max([1, *map(len, seen)])
    padded = torch.tensor([[*own, *[(0, 0, False)] * (longest - len(own))] for own in seen]).long()[None]
    return InitContext(
        theta0=replace(theta0, entity=theta0.entity * known[..., None]), known=known, eligible=known,
        novel=torch.tensor([list(novel)]), words=words, kinds=torch.tensor(kinds),
        other=padded[..., 0], relation=padded[..., 1], novel_is_tail=padded[..., 2] == 1,
        observed=torch.tensor([[place < len(own) for place in range(longest)] for own in seen])[None],
        root=0, keys=torch.tensor([[2, 0]]),
    )  # fmt: skip


def four_novel(of: Model = ANALOGY, seed: int = 0) -> InitContext:
    """Novel 0, a head and a tail; 5, with a triple; 9, with none; 11, without a word vector."""
    words = torch.randn(ENTITIES, 6, generator=torch.Generator().manual_seed(seed + 1))
    words[11] = 0
    seen: list[list[Seen]] = [
        [(1, 0, False), (2, 0, False), (3, 2, False), (4, 1, True)], [(7, 1, True)], [], [(2, 1, False), (6, 1, True)],
    ]  # fmt: skip
    theta0 = random_embedding(1, ENTITIES, RELATIONS, DIMENSION, seed, of)
    return insertion(theta0, [0, 5, 9, 11], seen, words, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3])
