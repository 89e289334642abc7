"""Word vectors dealt out at random: what controls without meaning share."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.base.streams import stream
from isi.insertion.core import Insertion
from isi.insertion.similarity import cosines


def dealt_word_similarity(insertion: Insertion, dealt: Tensor) -> Tensor:
    """``word_similarity``, each entity with the word vector that it is dealt, (M, E); shape (M, n, E)."""
    similarity = cosines(insertion.words)[dealt.gather(1, insertion.novel)]
    return similarity.gather(-1, dealt[:, None].expand_as(similarity))


def dealt_words(insertion: Insertion, purpose: str, groups: Tensor) -> Tensor:
    """Whose word vector each entity is dealt, in each model, among its group; those without one keep none; (M, E).

    Args:
        purpose: of the random streams.
        groups: within which words are dealt; ids, shape (E,).
    """
    wordy = (insertion.words != 0).any(-1)
    members = [(wordy & (groups == group)).nonzero().flatten() for group in torch.unique(groups)]
    dealt = torch.arange(len(insertion.words)).repeat(len(insertion.novel), 1)
    for model, key in enumerate(insertion.keys.tolist()):
        rng = stream(insertion.root, purpose, *key)
        for group in members:
            dealt[model, group] = group[torch.as_tensor(rng.permutation(len(group)))]
    return dealt
