"""What an initializer is given and what it gives.

Initializers by name, and how the report shows each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from isi.config import keywords
from isi.models.stack import Embedding
from isi.registry import Plugins

#: What an initializer without the knowledge that it needs falls back to.
FALLBACKS = (None, "es", "rs", "centroid")
NONE, ES, RS, CENTROID = range(4)


@dataclass(frozen=True)
class InitContext:
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
class InitResult:
    """Vectors of novel entities as inserted."""

    #: shape: (M, n, d)
    vectors: Tensor
    #: index into ``FALLBACKS``; shape: (M, n)
    fallback: Tensor
    #: the entities whose centroid was taken, if one was; shape: (M, n, E), bool
    indicators: Tensor | None = None


#: A function of an ``Insertion`` and its own options.
Initializer = Callable[..., InitResult]


def without_indicators(vectors: Tensor) -> InitResult:
    """Vectors of shape (M, n, d) that no indicators made and that needed no fallback."""
    return InitResult(vectors, torch.full(vectors.shape[:2], NONE))


#: The paper's baselines, ISI, controls (each has a part of what ISI has beside meaning), strong baselines that the
#: paper does not have, and anyone's own.
Role = Literal["paper", "isi", "control", "baseline", "own"]


@dataclass(frozen=True)
class Registered:
    """An initializer, and how the report shows it."""

    function: Initializer
    #: what people read
    label: str
    role: Role
    #: of its curves, ``#rrggbb``; where there is none, the report takes a spare one
    colour: str | None


INITIALIZERS: Plugins[Registered] = Plugins("isi.initializers")


def initializer(
    name: str, label: str | None = None, role: Role = "own", colour: str | None = None
) -> Callable[[Initializer], Initializer]:
    """Register an initializer; its parameters after the insertion are its options, and their types what they may be."""

    def register(function: Initializer) -> Initializer:
        INITIALIZERS.register(name, Registered(function, label or name, role, colour))
        return function

    return register


def options_of(name: str, given: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The options of an initializer, as keyword arguments of its function.

    Raises:
        InputError: where no initializer has the name, or it does not take these options; ``key`` is where
            they stand in params.
    """
    return keywords(INITIALIZERS.get(name, key).function, given, key)
