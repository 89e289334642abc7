"""``isi.check_initializer``: whether an initializer does what the library expects of one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from isi.checks.runner import changed_bits, gap, run_checks
from isi.checks.sample import sample_context
from isi.config import keywords
from isi.errors import InputError, at, short
from isi.initializers.api import (
    FALLBACKS,
    INITIALIZERS,
    NONE,
    Initializer,
    InitResult,
    NoRelationMap,
    Registered,
)
from isi.initializers.context import InitContext
from isi.models.bilinear import DistMult
from isi.models.distance import TransE
from isi.models.model import Model
from isi.models.stack import mapped, select, usual_torch


@dataclass(frozen=True)
class CheckedInitializer:
    """An initializer with options, and the input of its first call."""

    registered: Registered
    options: Mapping[str, Any]
    context: InitContext

    def __call__(self, context: InitContext) -> InitResult:
        """The checked result for a context."""
        return self.registered.initialize(context, self.options)

    @cached_property
    def first(self) -> InitResult:
        """The result of the first call."""
        return self(self.context)

    def needs(self, need: str) -> bool:
        return need in self.registered.needs


@dataclass(frozen=True)
class ScoreAlone(Model):
    """A model that has a score and no map."""

    invertible = False

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return (head * relation * tail).sum(-1)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:  # noqa: ARG002
        raise NoRelationMap

    inverse = transform


@usual_torch()
def check_initializer(
    initializer: str | Initializer | Registered, options: Mapping[str, Any] | None = None
) -> list[str]:
    """Run named checks of an initializer; the names of all, if it passes.

    Args:
        initializer: a registered name, the function, or its registration.
        options: they replace its ``defaults``.

    Raises:
        InputError: names the first check that fails, what it expects, and what was found.

    Example:
        >>> import isi
        >>> isi.check_initializer("es", {"k": 3})[:3]
        ['listed_options_are_valid', 'result_has_its_shapes', 'result_is_the_same_again']
    """
    registered = _registered(initializer)
    name = f"initializer {registered.name!r}"
    with_defaults = {**registered.defaults, **(options or {})}
    with at(name):
        checked = keywords(registered.function, with_defaults, "options")
    subject = CheckedInitializer(registered, checked, sample_context(DistMult()))
    return run_checks(name, CHECKS, subject)


def _registered(initializer: Any) -> Registered:
    if isinstance(initializer, Registered):
        return initializer
    if isinstance(initializer, str):
        return INITIALIZERS.get(initializer, "initializer")
    if not callable(initializer):
        expected = "expected a name, a function or its registration"
        raise InputError("argument 'initializer'", "", f"{expected}, got {short(initializer)}")
    initializers = [INITIALIZERS.get(name) for name in INITIALIZERS.names()]
    registered = (each for each in initializers if each.function is initializer)
    name = getattr(initializer, "__name__", "").strip("<>")
    return next(registered, None) or Registered(name, initializer, name)


def result_has_its_shapes(subject: CheckedInitializer) -> Iterator[str]:
    """Vectors (M, n, d), fallbacks (M, n) and weights (M, n, E) are finite numbers."""
    fallback = subject.first.fallback
    if not ((fallback >= 0) & (fallback < len(FALLBACKS))).all():
        yield f"a fallback is no place in FALLBACKS: {fallback.tolist()}"


def result_is_the_same_again(subject: CheckedInitializer) -> Iterator[str]:
    """A second call with the same context gives the same bytes (random numbers: context.draw)."""
    yield from _changes("the second call", subject(subject.context), subject.first)


def context_stays_as_it_is(subject: CheckedInitializer) -> Iterator[str]:
    """Known vectors and all other parts of the context keep their values."""
    context = mapped(subject.context, torch.clone)
    subject(context)
    before = _tensors(subject.context)
    for name, tensor in _tensors(context).items():
        yield from changed_bits(name, tensor, before[name])


def stack_has_no_effect(subject: CheckedInitializer) -> Iterator[str]:
    """A model has the same bytes in any place of any stack."""
    for models in ([0], [2, 1]):
        alone = subject(select(subject.context, torch.tensor(models)))
        chosen = select(subject.first, torch.tensor(models))
        yield from _changes(f"a stack of models {models}", alone, chosen)


def held_out_triples_have_no_effect(subject: CheckedInitializer) -> Iterator[str]:
    """Validation and test triples (``trained`` is false) are not used."""
    alone = select(subject.context, torch.tensor([0]))
    used, triples = alone.trained[0, :, None], alone.triples
    changed = subject(replace(alone, triples=torch.where(used, triples, triples.flip(0))))
    yield from gap("with other ones, a vector", changed.vectors, subject.first.vectors[:1])


def weights_are_of_known_entities(subject: CheckedInitializer) -> Iterator[str]:
    """Weights, if any, are of known entities and sum to 1; a centroid is their mean vector."""
    context, result = subject.context, subject.first
    if result.weights is None:
        return
    weights = result.weights.float()
    if weights.masked_select(~context.known[:, None].expand_as(weights)).any():
        yield "an entity that is not known has a weight"
    total = weights.sum(-1)
    yield from gap("a sum of weights", total, torch.ones_like(total))
    if result.is_centroid:
        yield from gap("a centroid", result.vectors, weights @ context.theta0.entity)


def kinds_may_be_used_or_missing(subject: CheckedInitializer) -> Iterator[str]:
    """It works where indicators are of the new entity's kind, and where kinds are missing."""
    context = replace(subject.context, by_kind=True)
    missing = replace(context, kinds=torch.full_like(context.kinds, -1))
    for each in (context, missing):
        subject(each)
    yield from ()


def missing_data_are_replaced(subject: CheckedInitializer) -> Iterator[str]:
    """New entities without the words or triples that it needs get finite vectors, by a fallback."""
    for need, without in LACKING.items():
        if subject.needs(need) and (subject(without(subject.context)).fallback == NONE).any():
            yield f"without {need} the fallback is NONE"
    subject(_without_words(_without_triples(subject.context)))


def needs_are_what_it_uses(subject: CheckedInitializer) -> Iterator[str]:
    """What ``needs`` lists changes the vectors, and it works without what is not listed."""
    whole = subject.first
    for need, without in LACKING.items():
        alone = subject(without(subject.context))
        if not subject.needs(need) and torch.ne(alone.fallback, whole.fallback).any():
            yield f"it falls back without {need}, which needs does not list"
        if subject.needs(need) and torch.equal(alone.vectors, whole.vectors):
            yield f"{need} have no effect, although needs lists them"
    for absent, model in (
        ("inverse, which needs does not list", ScoreAlone()),
        ("a linear score", TransE(2.0, True)),
    ):
        if subject.registered.misses(model) is None:
            try:
                subject(sample_context(model, 1))
            except NoRelationMap:
                yield f"it uses a map of relations of a model without {absent}"


def listed_options_are_valid(subject: CheckedInitializer) -> Iterator[str]:
    """Each setting in ``grid`` and ``calibration`` changes options that it has, to valid values."""
    registered = subject.registered
    settings = list(registered.calibration)
    for option, values in (registered.grid or {}).items():
        settings += [{option: value} for value in values]
    for setting in settings:
        keywords(registered.function, {**subject.options, **setting}, "grid or calibration")
    yield from ()


CHECKS = [
    listed_options_are_valid,
    result_has_its_shapes,
    result_is_the_same_again,
    context_stays_as_it_is,
    stack_has_no_effect,
    held_out_triples_have_no_effect,
    weights_are_of_known_entities,
    kinds_may_be_used_or_missing,
    missing_data_are_replaced,
    needs_are_what_it_uses,
]


def _without_words(context: InitContext) -> InitContext:
    """The new entities lose their word vectors."""
    words = context.words.clone()
    words[context.novel.flatten()] = 0
    return replace(context, words=words)


def _without_triples(context: InitContext) -> InitContext:
    return replace(context, observed=torch.zeros_like(context.observed))


#: What removes data that ``needs`` may list.
LACKING = {"words": _without_words, "insert_triples": _without_triples}


def _changes(where: str, result: InitResult, expected: InitResult) -> Iterator[str]:
    for part in ("vectors", "fallback"):
        yield from changed_bits(f"{part}: {where}", getattr(result, part), getattr(expected, part))


def _tensors(context: InitContext) -> dict[str, Tensor]:
    parts = {part.name: getattr(context, part.name) for part in fields(context)}
    tables = {"theta0.entity": context.theta0.entity, "theta0.relation": context.theta0.relation}
    return tables | {name: value for name, value in parts.items() if isinstance(value, Tensor)}
