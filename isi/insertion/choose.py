"""Which initializer ``isi.insert`` takes, with what options, and for how many new entities at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from isi.errors import InputError, short
from isi.initializers.api import INITIALIZERS, options_of
from isi.insertion.arguments import argument, mapping
from isi.models.model import Model
from isi.models.stack import Embedding

#: What is taken where a user names none, the best first (docs/method.md has the comparison): the first whose needs are
#: met and whose cost is small.
BEST = ("map_soft_hybrid", "soft_hybrid", "map_mean", "soft_rs", "soft_es", "mean")
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
    def possible_triples(self) -> int:
        """Triples that a new entity might have, as head or as tail."""
        return 2 * self.relations * self.entities


@dataclass(frozen=True)
class Choice:
    """An initializer, its options, and why it was chosen."""

    initializer: str
    options: Mapping[str, Any]
    why: str


def choose(
    initializer: str | None, options: Mapping[str, Any] | None, sizes: Sizes, triples: bool, words: bool, model: Model
) -> Choice:
    """The initializer of a name; without one, the best for what is known.

    Args:
        triples: whether a new entity has an insert triple.
        words: whether a new entity and a known one have word vectors.

    Raises:
        InputError: where there is no such initializer, it takes other options, the embedding is too large for it, or
            the model lacks what it needs.
    """
    given = mapping(options, "options")
    if initializer is not None and not isinstance(initializer, str):
        raise InputError("argument 'initializer'", "", f"expected a name, got {short(initializer)}")
    name, why = best(sizes, triples, words, model) if initializer is None else (initializer, "as asked")
    with argument("initializer"):
        registered = INITIALIZERS.get(name, "initializer")
        checked = options_of(name, {**registered.defaults, **given}, "initializer")
        registered.check(model)
        if registered.cost == "triples" and sizes.possible_triples * sizes.dimension > MOST:
            looks = f"{name} looks at {sizes.possible_triples:,} triples that an entity might have"
            raise InputError("", "", f"expected another one: {looks}")
        if registered.cost == "pairs" and sizes.entities**2 > PAIRS:
            compares = f"{name} compares the words of every two of {sizes.entities:,} entities"
            raise InputError("", "", f"expected another one: {compares}")
    return Choice(name, checked, why)


def best(sizes: Sizes, triples: bool, words: bool, model: Model) -> tuple[str, str]:
    """The name of the best initializer for what is known, and why it is taken."""
    lacking = {name for name, there in (("words", words), ("insert_triples", triples)) if not there}
    small = sizes.possible_triples * sizes.dimension <= QUICK
    fitting = [INITIALIZERS.get(name, name) for name in BEST]
    fitting = [one for one in fitting if not lacking & set(one.needs) and not one.misses(model)]
    affordable = next(one for one in fitting if small or one.cost == "entities")
    why = "the best for " + " and ".join(["words"] * words + ["triples"] * triples)
    return affordable.name, why if affordable is fitting[0] else f"{why} on a graph of this size"


def most_together(initializer: str, sizes: Sizes, linear: bool) -> int:
    """New entities in a table, at most; ``linear``: whether scores are linear in a vector."""
    if INITIALIZERS.get(initializer, "initializer").cost != "triples":
        return max(1, BUDGET // max(sizes.entities, sizes.relations * sizes.dimension))
    return max(1, BUDGET // (sizes.possible_triples * (1 if linear else sizes.dimension)))


#: Triples whose scores say the margin, at most.
MARGIN_TRIPLES = 1000


def margin_of(embedding: Embedding, triples: Tensor, margin: float | None) -> float:
    """The margin that makes scores of distances positive for triples and negative for others, as logistic losses need.

    It is the middle between both mean scores, or as given; zero where scores are linear.

    Args:
        embedding: a stack of one, whose margin is 0.
        triples: that it was trained on; ids, shape (T, 3).
    """
    if margin is not None or embedding.model.linear or not len(triples):
        return margin or 0.0
    head, relation, tail = triples[:: -(-len(triples) // MARGIN_TRIPLES)].T[:, None]
    with torch.no_grad():
        right = embedding.score(head, relation, tail).mean()
        other_heads = embedding.score(head.roll(1, 1), relation, tail).mean()
        other_tails = embedding.score(head, relation, tail.roll(1, 1)).mean()
    return -(right / 2 + (other_heads + other_tails) / 4).item()
