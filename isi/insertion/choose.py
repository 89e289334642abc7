"""Which initializer serves where a user names none, with what options, and on how many entities at once.

The margin of distances whose trainer had none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from isi.errors import InputError
from isi.initializers.api import options_of
from isi.insertion.arguments import argument, mapping, name_of
from isi.models.stack import Embedding

#: Options where a user gives none: those that were best on hidden entities (docs/method.md, "How the options of other
#: initializers were chosen"), and the paper's.
DEFAULTS: dict[str, dict[str, Any]] = {
    "es": {"k": 8},
    "rs": {"k": 18},
    "rs_alive": {"k": 18},
    "ers": {"k": 9, "candidates": 30},
    "es_permuted": {"k": 8},
    "es_permuted_kinds": {"k": 8},
    "class_noise": {"fraction": 0.1},
    "projection": {"penalty": 0.3},
    "soft_es": {"temperature": 0.07},
    "soft_rs": {"temperature": 0.02},
    "soft_hybrid": {"word_weight": 12.0, "relation_weight": 32.0},
    "ridge": {"strength": 1e-4, "ratio": 3},
    "map_mean": {"strength": 0.1, "ratio": 1},
    "map_ers": {"k": 9, "candidates": 30, "strength": 0.2, "ratio": 1},
    "map_soft_hybrid": {"word_weight": 16.0, "relation_weight": 16.0, "strength": 0.2, "ratio": 1},
}
#: Initializers that look at entities, and not at every triple that a new one might have.
BY_ENTITY = frozenset({
    "class_noise", "ers", "es", "es_permuted", "es_permuted_kinds", "gaussian", "gaussian_centred", "iu", "kind_mean",
    "mean", "projection", "rs", "rs_alive", "soft_es", "soft_hybrid", "soft_rs", "xavier",
})  # fmt: skip
#: Those that do not ask where a relation takes a head, and so serve a family without an inverse.
NEED_NO_MAP = frozenset({
    "class_noise", "es", "es_permuted", "es_permuted_kinds", "gaussian", "gaussian_centred", "iu", "kind_mean",
    "map_mean", "mean", "neighbour_mean", "projection", "soft_es", "xavier",
})  # fmt: skip
#: Those that compare the words of every two entities.
BY_PAIR = frozenset({"es_permuted", "es_permuted_kinds"})
#: Numbers in the vectors of all triples that a new entity might have, up to which the default is MAP; and at most.
QUICK, MOST = 2**24, 2**28
#: Numbers in a table of every two entities, at most.
PAIRS = 2**29
#: Numbers in a table of some new entities, at most.
BUDGET = 2**24


@dataclass(frozen=True)
class Sizes:
    """How large an embedding is, with its new entities."""

    entities: int
    relations: int
    dimension: int

    @property
    def cells(self) -> int:
        """Triples that a new entity might have, as head or as tail."""
        return 2 * self.relations * self.entities

    @property
    def vectors(self) -> int:
        """Numbers in the vectors of all these triples."""
        return self.cells * self.dimension


@dataclass(frozen=True)
class Choice:
    """An initializer, its options, and why it was chosen."""

    initializer: str
    options: Mapping[str, Any]
    why: str


def choose(
    initializer: str | None, options: Mapping[str, Any] | None, sizes: Sizes, triples: bool, words: bool,
    invertible: bool = True,
) -> Choice:  # fmt: skip
    """The initializer of a name; without one, the best that what is known allows.

    Args:
        triples: whether a new entity has one.
        words: whether a new entity has a word vector, and a known one, too.
        invertible: whether it is known where a relation takes a head.

    Raises:
        InputError: where there is no such initializer, it takes other options, or the embedding is too large for it or
            of a family that it does not serve.
    """
    given, best = mapping(options, "options"), _best if invertible else _best_without_map
    asked = name_of(initializer, "initializer")
    name, why = best(sizes, triples, words) if asked is None else (asked, "as asked")
    with argument("initializer"):
        checked = options_of(name, DEFAULTS.get(name, {}) | given, "initializer")
    _check_size(name, sizes)
    if not invertible and name not in NEED_NO_MAP:
        expected = f"expected one that needs no inverse of a relation: {', '.join(sorted(NEED_NO_MAP))}; got {name!r}"
        raise InputError("argument 'initializer'", "", expected)
    return Choice(name, checked, why)


def _best(sizes: Sizes, triples: bool, words: bool) -> tuple[str, str]:
    """Its name, and why."""
    if not triples:
        return "soft_es", "of what goes by words alone, the best"
    small = sizes.vectors <= QUICK
    if words:
        known = "words and triples"
        return ("map_soft_hybrid", f"the best for {known}") if small else ("soft_hybrid", _next_best(known))
    return ("map_mean", "the best for triples alone") if small else ("soft_rs", _next_best("triples alone"))


def _best_without_map(sizes: Sizes, triples: bool, words: bool) -> tuple[str, str]:
    """The same where it is not known where a relation takes a head."""
    if triples and sizes.vectors <= QUICK:
        return "map_mean", "the best where relations have no inverse"
    served = "words" if words else "neither words nor inverses of relations"
    return ("soft_es", _next_best(served)) if words else ("mean", _next_best(served))


def _next_best(known: str) -> str:
    return f"the best for {known} on a graph of this size"


def _check_size(name: str, sizes: Sizes) -> None:
    if name not in BY_ENTITY and sizes.vectors > MOST:
        expected = f"expected another one: {name} looks at {sizes.cells:,} triples that an entity might have"
        raise InputError("argument 'initializer'", "", expected)
    if name in BY_PAIR and sizes.entities**2 > PAIRS:
        expected = f"expected another one: {name} compares the words of every two of {sizes.entities:,} entities"
        raise InputError("argument 'initializer'", "", expected)


def at_once(name: str, sizes: Sizes, linear: bool) -> int:
    """New entities in a table, at most."""
    if name in BY_ENTITY:
        return max(1, BUDGET // max(sizes.entities, sizes.relations * sizes.dimension))
    return max(1, BUDGET // (sizes.cells * (1 if linear else sizes.dimension)))


#: Triples whose scores tell the margin, at most.
ASKED = 1000


def middle(embedding: Embedding, triples: Tensor, margin: float | None) -> float:
    """What makes scores positive for triples and negative for others: less the middle of both means, or as given.

    Args:
        embedding: a stack of one, whose margin is 0.
        triples: that it was trained on; ids, shape (T, 3).
    """
    if margin is not None or embedding.model.linear or not len(triples):
        return margin or 0.0
    head, relation, tail = triples[:: -(-len(triples) // ASKED)].T[:, None]
    with torch.no_grad():
        right = embedding.score(head, relation, tail).mean()
        other_heads = embedding.score(head.roll(1, 1), relation, tail).mean()
        other_tails = embedding.score(head, relation, tail.roll(1, 1)).mean()
    return -(right / 2 + (other_heads + other_tails) / 4).item()
