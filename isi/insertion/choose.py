"""Which initializer ``isi.insert`` takes, with what options, and for how many new entities at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from isi.errors import InputError, short
from isi.initializers.api import INITIALIZERS, Registered, options_of
from isi.insertion.arguments import argument, options_by_name
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
#: Triples whose scores say the margin, at most.
MARGIN_TRIPLES = 1000


@dataclass(frozen=True)
class Choice:
    """An initializer, its options, and why it was chosen."""

    registered: Registered
    options: Mapping[str, Any]
    why: str
    #: new entities that are initialized in one table, at most
    together: int


def choose(
    initializer: Any, options: Any, entities: int, relations: int, dimension: int, triples: bool, words: bool,
    model: Model,
) -> Choice:  # fmt: skip
    """The initializer of a name; without one, the best for what is known.

    Args:
        entities: known and new ones.
        triples: whether a new entity has an insert triple.
        words: whether a new entity and a known one have word vectors.

    Raises:
        InputError: where there is no such initializer, it takes other options, the embedding is too large for it, or
            the model lacks what it needs.
    """
    given, possible = options_by_name(options, "options"), 2 * relations * entities
    with argument("initializer"):
        if not isinstance(initializer, str | None):
            raise InputError("", "", f"expected a name, got {short(initializer)}")
        small = possible * dimension <= QUICK
        name, why = best(small, triples, words, model) if initializer is None else (initializer, "as asked")
        registered = INITIALIZERS.get(name, "initializer")
        checked = options_of(name, {**registered.defaults, **given}, "initializer")
        registered.check(model)
        if registered.cost == "triples" and possible * dimension > MOST:
            looks = f"{name} looks at {possible:,} triples that an entity might have"
            raise InputError("", "", f"expected another one: {looks}")
        if registered.cost == "pairs" and entities**2 > PAIRS:
            compares = f"{name} compares the words of every two of {entities:,} entities"
            raise InputError("", "", f"expected another one: {compares}")
    numbers = max(entities, relations * dimension)  # of one new entity
    if registered.cost == "triples":
        numbers = possible if model.linear else possible * dimension
    return Choice(registered, checked, why, max(1, BUDGET // numbers))


def best(small: bool, triples: bool, words: bool, model: Model) -> tuple[str, str]:
    """The name of the best initializer for what is known, and why it is taken; ``small``: whether MAP is quick."""
    lacking = {name for name, there in (("words", words), ("insert_triples", triples)) if not there}
    fitting = [INITIALIZERS.get(name, name) for name in BEST]
    fitting = [registered for registered in fitting if not lacking & set(registered.needs)]
    fitting = [registered for registered in fitting if not registered.misses(model)]
    affordable = next(registered for registered in fitting if small or registered.cost == "entities")
    why = "the best for " + " and ".join(["words"] * words + ["triples"] * triples)
    return affordable.name, why if affordable is fitting[0] else f"{why} on a graph of this size"


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
