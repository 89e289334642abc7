"""Permuted ES: centroids as ES takes them, of entities chosen without meaning (a control)."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.base.params import Count
from isi.base.streams import stream
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.similarity import cosines, nearest_by_words


@initializer("es_permuted", label="Permuted ES", role="control", colour="#8db4cf")
def permuted_entity_similarity(insertion: Insertion, k: Count) -> Initial:
    """ES with the word vectors dealt out anew among the entities that have one."""
    return nearest_by_words(insertion, permuted_word_similarity(insertion), k)


def permuted_word_similarity(insertion: Insertion) -> Tensor:
    """``word_similarity``, each entity with the word vector that each model's permutation deals it; shape (M, n, E)."""
    dealt = permuted_words(insertion)
    similarity = cosines(insertion.words)[dealt.gather(1, insertion.novel)]
    return similarity.gather(-1, dealt[:, None].expand_as(similarity))


def permuted_words(insertion: Insertion) -> Tensor:
    """Whose word vector each entity is dealt, in each model; those without one keep none; shape (M, E)."""
    wordy = (insertion.words != 0).any(-1).nonzero().flatten()
    dealt = torch.arange(len(insertion.words)).repeat(len(insertion.novel), 1)
    for model, key in enumerate(insertion.keys.tolist()):
        order = stream(insertion.root, "es_permuted", *key).permutation(len(wordy))
        dealt[model, wordy] = wordy[torch.from_numpy(order)]
    return dealt
