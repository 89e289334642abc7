"""Permuted ES: centroids as ES takes them, of entities chosen without meaning (a control)."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.dealing import dealt_word_similarity, dealt_words
from isi.insertion.similarity import nearest_by_words


@initializer("es_permuted", label="Permuted ES", role="control", colour="#8db4cf")
def permuted_entity_similarity(insertion: Insertion, k: Count) -> Initial:
    """ES with the word vectors dealt out anew among the entities that have one."""
    return nearest_by_words(insertion, dealt_word_similarity(insertion, permuted_words(insertion)), k)


def permuted_words(insertion: Insertion) -> Tensor:
    """Whose word vector each entity is dealt, in each model; shape (M, E)."""
    return dealt_words(insertion, "es_permuted", torch.zeros_like(insertion.kinds))
