"""What an initializer is given and what it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from isi.embeddings.stack import Embedding

#: What an initializer without the knowledge that it needs falls back to.
FALLBACKS = (None, "es", "rs", "centroid")
NONE, ES, RS, CENTROID = range(4)


@dataclass(frozen=True)
class Insertion:
    """All that an initializer may look at, for a stack of M models and n novel entities each.

    No validation or test triple is in it.
    """

    #: Θ⁰; rows of novel entities are zero
    theta0: Embedding
    #: entities of D⁰; shape: (M, E), bool
    known: Tensor
    #: known entities with a training triple in D⁰, the only ones to serve as indicators; shape: (M, E), bool
    eligible: Tensor
    #: ids; shape: (M, n)
    novel: Tensor
    #: word vectors, zero where there is none; shape: (E, w)
    words: Tensor
    #: what kind each entity is of; ids, shape: (E,)
    kinds: Tensor
    #: the known end, the relation, and whether the novel entity is the tail, of each insert triple,
    #: padded to I; shapes: (M, n, I)
    other: Tensor
    relation: Tensor
    novel_is_tail: Tensor
    #: which of them are triples and not padding; shape: (M, n, I), bool
    observed: Tensor
    #: root of the random streams, and what each model's depend on beside it; shape: (M, K)
    root: int
    keys: Tensor


@dataclass(frozen=True)
class Initial:
    """Vectors of novel entities as inserted."""

    #: shape: (M, n, d)
    vectors: Tensor
    #: index into ``FALLBACKS``; shape: (M, n)
    fallback: Tensor
    #: the entities whose centroid was taken, if one was; shape: (M, n, E), bool
    indicators: Tensor | None = None


#: A function of an ``Insertion`` and its own options.
Initializer = Callable[..., Initial]


def unaided(vectors: Tensor) -> Initial:
    """Vectors of shape (M, n, d) that no indicators made and that needed no fallback."""
    return Initial(vectors, torch.full(vectors.shape[:2], NONE))
