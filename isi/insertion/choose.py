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
from isi.initializers.api import INITIALIZERS, Cost, Registered, options_of
from isi.insertion.arguments import argument, mapping, name_of
from isi.models.model import Model
from isi.models.stack import Embedding

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


#: Initializers that are taken where a user names none, the best first: what it needs must be there, and the embedding
#: small enough (docs/method.md says on what evidence).
BEST = ("map_soft_hybrid", "soft_hybrid", "map_mean", "soft_rs", "soft_es", "mean")


def choose(
    initializer: str | None, options: Mapping[str, Any] | None, sizes: Sizes, triples: bool, words: bool, model: Model
) -> Choice:
    """The initializer of a name; without one, the best that what is known allows.

    Args:
        triples: whether a new entity has one.
        words: whether a new entity has a word vector, and a known one, too.

    Raises:
        InputError: where there is no such initializer, it takes other options, or the embedding is too large for it or
            of a model that it does not serve.
    """
    given, asked = mapping(options, "options"), name_of(initializer, "initializer")
    name, why = best(sizes, triples, words, model) if asked is None else (asked, "as asked")
    with argument("initializer"):
        registered = INITIALIZERS.get(name, "initializer")
        checked = options_of(name, {**registered.defaults, **given}, "initializer")
        registered.check(model)
    _check_size(registered, sizes)
    return Choice(name, checked, why)


def best(sizes: Sizes, triples: bool, words: bool, model: Model) -> tuple[str, str]:
    """The name of the best initializer, and why it is: whose needs are met, and whose cost is small."""
    lacking = ({"words"} if not words else set()) | ({"insert_triples"} if not triples else set())
    small = sizes.vectors <= QUICK
    fitting = [
        one for one in (INITIALIZERS.get(name, name) for name in BEST)
        if not lacking & set(one.needs) and not one.misses(model)
    ]  # fmt: skip
    affordable = [one for one in fitting if small or one.cost == "entities"]
    known = " and ".join(["words"] * words + ["triples"] * triples)
    where = "" if affordable[0] is fitting[0] else " on a graph of this size"
    return affordable[0].name, f"the best for {known}{where}"


def _check_size(registered: Registered, sizes: Sizes) -> None:
    name = registered.name
    if registered.cost == "triples" and sizes.vectors > MOST:
        expected = f"expected another one: {name} looks at {sizes.cells:,} triples that an entity might have"
        raise InputError("argument 'initializer'", "", expected)
    if registered.cost == "pairs" and sizes.entities**2 > PAIRS:
        expected = f"expected another one: {name} compares the words of every two of {sizes.entities:,} entities"
        raise InputError("argument 'initializer'", "", expected)


def at_once(cost: Cost, sizes: Sizes, linear: bool) -> int:
    """New entities in a table, at most."""
    if cost != "triples":
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
