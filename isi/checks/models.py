"""``isi.check_model``: whether a model does what the library expects of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from isi.checks.runner import changed_bits, gap, run_checks
from isi.checks.sample import RELATIONS, dimension_of
from isi.errors import InputError, at, short
from isi.models.model import MODELS, Model, make_model
from isi.models.scoring import DenseTriples, TripleList, Triples
from isi.models.stack import Embedding, mapped, rows, select, uniform, usual_torch

STACK, ENTITIES = 3, 5
#: Numbers of entities for which arrays fill the registers of a processor, or do not.
UNEVEN = (5, 13, 30)


@dataclass(frozen=True)
class CheckedModel:
    """A model, and a length of vectors that it can have."""

    model: Model
    dimension: int

    def embedding(self, models: int = STACK, entities: int = ENTITIES) -> Embedding:
        """A random stack in double precision."""
        generator = torch.Generator().manual_seed(models)
        shapes = (entities, self.dimension), (RELATIONS, self.model.width(self.dimension))
        tables = [torch.randn(models, *shape, generator=generator).double() for shape in shapes]
        return Embedding(tables[0], tables[1], self.model)

    @cached_property
    def random(self) -> Embedding:
        return self.embedding()


@usual_torch()
def check_model(model: str | Model, options: Mapping[str, Any] | None = None) -> list[str]:
    """Run named checks of a model; the names of all, if it passes.

    Args:
        model: a registered name, or a model.
        options: of a name; they replace its ``defaults``.

    Raises:
        InputError: names the first check that fails, what it expects, and what was found.

    Example:
        >>> import isi
        >>> isi.check_model("transe", {"squared": False})[:2]
        ['options_are_fields', 'width_is_a_number_of_columns']
    """
    checked = _model(model, options or {})
    name = f"model {model!r}" if isinstance(model, str) else f"model {type(checked).__name__}"
    with at(name):
        subject = CheckedModel(checked, dimension_of(checked))
    return run_checks(name, CHECKS, subject)


def _model(model: Any, options: Mapping[str, Any]) -> Model:
    if isinstance(model, str):
        kind = MODELS.get(model, "model")
        return make_model(model, {**kind.defaults, **options}, "options")
    if not isinstance(model, Model):
        expected = f"expected a name or a model (with its options), got {short(model)}"
        raise InputError("argument 'model'", "", expected)
    return model


def options_are_fields(subject: CheckedModel) -> Iterator[str]:
    """A model is a frozen dataclass, and equal options make equal models."""
    model: Any = subject.model
    about = getattr(model, "__dataclass_params__", None)
    if about is None or not about.frozen:
        yield "it is none"
    elif replace(model) != model or hash(replace(model)) != hash(model):
        yield "a copy differs"


def width_is_a_number_of_columns(subject: CheckedModel) -> Iterator[str]:
    """``width`` gives the length of a relation's row, and ``uniform`` tables have it."""
    width = subject.model.width(subject.dimension)
    if not isinstance(width, int) or width < 1:
        yield f"it is {short(width)}"
    known, keys = torch.ones(1, ENTITIES, dtype=torch.bool), torch.zeros(1, 1, dtype=torch.int64)
    tables = uniform(known, RELATIONS, subject.model, subject.dimension, 0.5, 0, keys)
    if not torch.isfinite(tables.score(*torch.zeros(3, 1, 1, dtype=torch.int64))).all():
        yield "a score of initial vectors is not finite"


def all_ways_to_score_agree(subject: CheckedModel) -> Iterator[str]:
    """A triple has one score, alone, among all heads, tails or relations, in tables and lists; if
    ``linear``, it is ⟨transform(h, r), t⟩ = ⟨h, transform_tail(t, r)⟩.
    """
    expected = _one_by_one(subject.random)
    if expected.std() < 1e-6:
        yield "all random triples have the same score"
    for way, scores in _scores(subject.random).items():
        yield from gap(way, scores, expected)


def gradients_are_those_of_the_score(subject: CheckedModel) -> Iterator[str]:
    """The gradients of ``scores``, in tables and lists, are those of ``score`` by autograd."""
    ids = _all_ids(STACK, ENTITIES)
    slopes = torch.randn(ids[0].shape, generator=torch.Generator().manual_seed(1)).double()
    free = mapped(subject.random, lambda table: table.clone().requires_grad_())
    with torch.enable_grad():
        total = (slopes * free.score(*ids)).sum()
    expected = torch.autograd.grad(total, (free.entity, free.relation))
    for form, gradients in _gradients(subject.random, slopes).items():
        for gradient, right in zip(gradients, expected, strict=True):
            yield from gap(f"a gradient in {form}", gradient, right)


def zero_vectors_have_finite_gradients(subject: CheckedModel) -> Iterator[str]:
    """Scores and gradients of rows of zeros, as novel entities have at first, are finite."""
    theta = replace(subject.random, entity=torch.zeros_like(subject.random.entity))
    for way, scores in _scores(theta).items():
        if not torch.isfinite(scores).all():
            yield f"{way} is not"
    for form, gradients in _gradients(theta, torch.ones_like(scores)).items():
        if not all(torch.isfinite(gradient).all() for gradient in gradients):
            yield f"a gradient in {form} is not"


def maps_undo_each_other(subject: CheckedModel) -> Iterator[str]:
    """A head mapped there, back and there again is as mapped once; so is a tail, back first."""
    if not subject.model.invertible:
        return
    vectors, relation = subject.random.entity, subject.random.relation[:, :1]
    there, back = subject.model.transform, subject.model.inverse
    for first, second in ((there, back), (back, there)):
        once = first(vectors, relation)
        again = first(second(once, relation), relation)
        yield from gap(f"{first.__name__} of {second.__name__}", again, once)


def constrained_vectors_stay(subject: CheckedModel) -> Iterator[str]:
    """``constrain`` keeps the shape, treats each row by itself, and leaves its results as they are,
    also of rows of zeros.
    """
    entity, constrain = subject.random.entity, subject.model.constrain
    kept = constrain(torch.cat([entity, torch.zeros_like(entity)]))
    yield from gap("constrain(constrain(v))", constrain(kept), kept)  # NaN is not near itself
    yield from gap("constrain(v) of one row", constrain(entity[:1, :1]), kept[:1, :1])


def distance_has_a_margin(subject: CheckedModel) -> Iterator[str]:
    """If ``distance``, f is the option ``margin`` minus a distance of at least 0."""
    theta, model = subject.random, subject.model
    if not model.distance:
        return
    ids = _all_ids(STACK, ENTITIES)
    more: Any = replace(model, margin=model.margin + 1)  # type: ignore[attr-defined, type-var]
    score = theta.score(*ids)
    yield from gap("f with a margin of 1 more", replace(theta, model=more).score(*ids), score + 1)
    if (score > model.margin).any():  # type: ignore[attr-defined]
        yield "a score exceeds the margin"


def stack_has_no_effect(subject: CheckedModel) -> Iterator[str]:
    """Scores, gradients and maps of a model have the same bytes in any place of any stack."""
    for entities in UNEVEN:
        stack = mapped(subject.embedding(4, entities), Tensor.float)
        together = _results(stack)
        for models in ([1], [3, 0, 2]):
            chosen = torch.tensor(models)
            for name, alone in _results(select(stack, chosen)).items():
                label = f"{name} of models {models} of {entities} entities"
                yield from changed_bits(label, alone, together[name][chosen])


CHECKS: list[Callable[[CheckedModel], Iterator[str]]] = [
    options_are_fields,
    width_is_a_number_of_columns,
    all_ways_to_score_agree,
    gradients_are_those_of_the_score,
    zero_vectors_have_finite_gradients,
    maps_undo_each_other,
    constrained_vectors_stay,
    distance_has_a_margin,
    stack_has_no_effect,
]


def _all_ids(models: int, entities: int) -> tuple[Tensor, Tensor, Tensor]:
    """Heads, relations and tails of all triples, by relation, head, tail; shapes (M, T)."""
    each = torch.arange(RELATIONS), torch.arange(entities), torch.arange(entities)
    relation, head, tail = torch.cartesian_prod(*each).T.expand(models, 3, -1).unbind(1)
    return head, relation, tail


def _one_by_one(theta: Embedding) -> Tensor:
    """The scores of all triples, each from three vectors; shape (M, T)."""
    ids = torch.stack([part[0] for part in _all_ids(*theta.entity.shape[:2])], 1).tolist()
    scores = [
        theta.model.score(entity[head], row[relation], entity[tail])
        for entity, row in zip(theta.entity, theta.relation, strict=True)
        for head, relation, tail in ids
    ]
    return torch.stack(scores).view(len(theta.entity), -1)


def _forms(theta: Embedding) -> dict[str, Triples]:
    """All triples as tables, and as a list."""
    models, entities = theta.entity.shape[:2]
    ids = (part.flatten() for part in _all_ids(models, entities))
    model = torch.arange(models).repeat_interleave(RELATIONS * entities**2)
    triples = TripleList((models, RELATIONS, entities), model, *ids)
    return {"tables": DenseTriples.of(theta.entity, theta.relation), "lists": triples}


def _scores(theta: Embedding) -> dict[str, Tensor]:
    """The scores of all triples by each way to compute them; shape (M, T)."""
    head, relation, tail = ids = _all_ids(*theta.entity.shape[:2])
    among = {
        "score_tails": (theta.score_tails(head, relation), tail),
        "score_heads": (theta.score_heads(relation, tail), head),
        "score_relations": (theta.score_relations(head, tail), relation),
    }
    ways = {name: scores.gather(2, end[..., None])[..., 0] for name, (scores, end) in among.items()}
    for form, triples in _forms(theta).items():
        scores = theta.model.scores(theta.entity, theta.relation, triples)[0]
        ways[f"a score in {form}"] = scores.reshape(head.shape).clone()
    if theta.model.linear:
        heads, tails = rows(theta.entity, head), rows(theta.entity, tail)
        of_relation = rows(theta.relation, relation)
        ways["⟨transform(h, r), t⟩"] = (theta.model.transform(heads, of_relation) * tails).sum(-1)
        back = theta.model.transform_tail(tails, of_relation)
        ways["⟨h, transform_tail(t, r)⟩"] = (heads * back).sum(-1)
    return {"score": theta.score(*ids), **ways}


def _gradients(theta: Embedding, slopes: Tensor) -> dict[str, tuple[Tensor, Tensor]]:
    """The gradients of Σ slope · f of all triples by their form; ``slopes``: (M, T)."""
    gradients = {}
    for form, triples in _forms(theta).items():
        scores, backward = theta.model.scores(theta.entity, theta.relation, triples)
        gradients[form] = backward(slopes.reshape(scores.shape))
    return gradients


def _results(theta: Embedding) -> dict[str, Tensor]:
    """Scores, gradients and maps of a stack; shapes (M, ...)."""
    model, results = theta.model, _scores(theta)
    for form, tables in _gradients(theta, results["a score in tables"] / 8).items():
        results[f"gradients of entities in {form}"] = tables[0]
        results[f"gradients of relations in {form}"] = tables[1]
    if model.invertible:
        vectors = theta.entity[:, :RELATIONS]
        results["transform"] = model.transform(vectors, theta.relation)
        results["inverse"] = model.inverse(vectors, theta.relation)
    return results
