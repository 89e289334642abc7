"""``isi.check_model``: whether a model does what the library expects of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from torch import Tensor

from isi.checks.runner import changed_bits, gap, run_checks
from isi.checks.sample import RELATIONS, dimension_of, sample_graph
from isi.errors import InputError, at, short
from isi.graph.sessions import TRAIN, Session
from isi.models.model import MODELS, Model, make_model
from isi.models.scoring import DenseTriples, TripleList, Triples
from isi.models.stack import Embedding, mapped, select, uniform, usual_torch
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, is_compiled, run_batches, run_epoch, start

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
        width = self.model.width(self.dimension)
        entity = torch.randn(models, entities, self.dimension, generator=generator)
        relation = torch.randn(models, RELATIONS, width, generator=generator)
        return Embedding(entity.double(), relation.double(), self.model)

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
    """A triple has one score, alone, among all heads, tails or relations, in tables and lists."""
    theta = subject.random
    ids = _all_ids(STACK, ENTITIES)
    head, relation, tail = ids
    expected = torch.stack([_one_by_one(theta, model, ids) for model in range(STACK)])
    if expected.std() < 1e-6:
        yield "all random triples have the same score"
    forms = {
        "score": theta.score(*ids),
        "score_tails": _picked(theta.score_tails(head, relation), tail),
        "score_heads": _picked(theta.score_heads(relation, tail), head),
        "score of all relations": _picked(theta.score_relations(head, tail), relation),
    }
    for form, triples in _forms(theta).items():
        scores = subject.model.scores(theta.entity, theta.relation, triples)[0]
        forms[f"scores of {form}"] = scores.reshape(expected.shape)
    for way, scores in forms.items():
        yield from gap(way, scores, expected)


def gradients_are_those_of_the_score(subject: CheckedModel) -> Iterator[str]:
    """The gradients of ``scores``, in tables and lists, are those of ``score`` by autograd."""
    theta, ids = subject.random, _all_ids(STACK, ENTITIES)
    slopes = torch.randn(ids[0].shape, generator=torch.Generator().manual_seed(1)).double()
    free = mapped(theta, lambda table: table.clone().requires_grad_())
    with torch.enable_grad():
        total = (slopes * free.score(*ids)).sum()
    expected = torch.autograd.grad(total, (free.entity, free.relation))
    for form, triples in _forms(theta).items():
        scores, backward = subject.model.scores(theta.entity, theta.relation, triples)
        gradients = backward(slopes.reshape(scores.shape))
        for name, gradient, right in zip(
            ("entities", "relations"), gradients, expected, strict=True
        ):
            yield from gap(f"the gradient of {name} in {form}", gradient, right)


def zero_vectors_have_finite_gradients(subject: CheckedModel) -> Iterator[str]:
    """Scores and gradients of rows of zeros, as novel entities have at first, are finite."""
    theta = subject.random
    entity = torch.zeros_like(theta.entity)
    for form, triples in _forms(theta).items():
        scores, backward = subject.model.scores(entity, theta.relation, triples)
        values = [scores.clone(), *backward(torch.ones_like(scores))]
        if not all(torch.isfinite(value).all() for value in values):
            yield f"in {form}, some are not"


def maps_undo_each_other(subject: CheckedModel) -> Iterator[str]:
    """A head mapped there, back and there again is as mapped once; so is a tail, back first."""
    model = subject.model
    if not model.invertible:
        return
    vectors, relation = subject.random.entity, subject.random.relation[:, :1]
    there, back = model.transform(vectors, relation), model.inverse(vectors, relation)
    again = model.transform(model.inverse(there, relation), relation)
    yield from gap("transform(inverse(transform(h)))", again, there)
    again = model.inverse(model.transform(back, relation), relation)
    yield from gap("inverse(transform(inverse(t)))", again, back)


def constrained_vectors_stay(subject: CheckedModel) -> Iterator[str]:
    """``constrain`` keeps the shape, treats each row by itself, and leaves its results as they are,
    also of rows of zeros.
    """
    entity, model = subject.random.entity, subject.model
    kept = model.constrain(torch.cat([entity, torch.zeros_like(entity)]))
    if kept.shape != (2 * len(entity), *entity.shape[1:]) or not torch.isfinite(kept).all():
        yield f"the shape is {tuple(kept.shape)}, or a number is not finite"
        return
    yield from gap("constrain(constrain(v))", model.constrain(kept), kept)
    yield from gap("constrain(v) of one row", model.constrain(entity[:1, :1]), kept[:1, :1])


def linear_score_is_a_product(subject: CheckedModel) -> Iterator[str]:
    """If ``linear``, f = ⟨transform(h, r), t⟩ = ⟨h, transform_tail(t, r)⟩."""
    theta, model = subject.random, subject.model
    if not model.linear:
        return
    head, relation, tail = theta.entity[:, :2], theta.relation[:, :2], theta.entity[:, 2:4]
    score = model.score(head, relation, tail)
    yield from gap("⟨transform(h, r), t⟩", (model.transform(head, relation) * tail).sum(-1), score)
    back = model.transform_tail(tail, relation)
    yield from gap("⟨h, transform_tail(t, r)⟩", (head * back).sum(-1), score)


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
        theta = subject.embedding(4, entities)
        stack = replace(theta, entity=theta.entity.float(), relation=theta.relation.float())
        together = _results(stack)
        for models in ([1], [3, 0, 2]):
            chosen = torch.tensor(models)
            for name, alone in _results(select(stack, chosen)).items():
                label = f"{name} of models {models} of {entities} entities"
                yield from changed_bits(label, alone, together[name][chosen])


def compiled_updates_are_those_of_batches(subject: CheckedModel) -> Iterator[str]:
    """If compiled for batches of one observation, an epoch gives the numbers of any other batch."""
    if not is_compiled(subject.model, 1):
        return
    graph, keys = sample_graph().part(np.arange(20)), torch.tensor([[0, 1]])
    everyone = torch.ones(1, len(graph.entities), dtype=torch.bool)
    splits = torch.full((1, len(graph.triples)), TRAIN, dtype=torch.int8)
    data = training_data(Session(graph, everyone, splits), "check", keys)
    theta = uniform(everyone, RELATIONS, subject.model, subject.dimension, 0.3, 0, keys)
    negatives = Negatives(mode="sampled", ratio=2)
    settings = Optimizer(batch_size=1, learning_rate=0.1, weight_decay=1e-3, max_epochs=1)
    compiled, plain = start(theta), start(theta)
    run_epoch(compiled, data, negatives, settings, 0, 1)
    run_batches(plain, data, negatives, settings, 0, 1)
    for name in ("entity", "relation"):
        tables = (getattr(state.embedding, name) for state in (compiled, plain))
        yield from gap(f"the table {name}", *tables)


CHECKS: list[Callable[[CheckedModel], Iterator[str]]] = [
    options_are_fields,
    width_is_a_number_of_columns,
    all_ways_to_score_agree,
    gradients_are_those_of_the_score,
    zero_vectors_have_finite_gradients,
    maps_undo_each_other,
    constrained_vectors_stay,
    linear_score_is_a_product,
    distance_has_a_margin,
    stack_has_no_effect,
]
if find_spec("numba"):  # of the extra "pipeline"
    CHECKS.append(compiled_updates_are_those_of_batches)


def _all_ids(models: int, entities: int) -> tuple[Tensor, Tensor, Tensor]:
    """Heads, relations and tails of all triples, by relation, head, tail; shapes (M, T)."""
    each = torch.arange(RELATIONS), torch.arange(entities), torch.arange(entities)
    relation, head, tail = torch.cartesian_prod(*each).T.expand(models, 3, -1).unbind(1)
    return head, relation, tail


def _one_by_one(theta: Embedding, model: int, ids: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """The scores of triples of one model, each from three vectors."""
    entity, relation = theta.entity[model], theta.relation[model]
    triples = torch.stack([part[model] for part in ids], 1).tolist()
    return torch.stack(
        [theta.model.score(entity[h], relation[r], entity[t]) for h, r, t in triples]
    )


def _picked(scores: Tensor, answer: Tensor) -> Tensor:
    """The scores of answers, (M, Q), among those of all candidates, (M, Q, C)."""
    return scores.gather(2, answer[..., None])[..., 0]


def _forms(theta: Embedding) -> dict[str, Triples]:
    """All triples as tables, and as a list."""
    models, entities = theta.entity.shape[:2]
    ids = (part.flatten() for part in _all_ids(models, entities))
    model = torch.arange(models).repeat_interleave(RELATIONS * entities**2)
    listed = TripleList((models, RELATIONS, entities), model, *ids)
    return {"tables": DenseTriples.of(theta.entity, theta.relation), "lists": listed}


def _results(theta: Embedding) -> dict[str, Tensor]:
    """Scores, gradients and maps of a stack; shapes (M, ...)."""
    model, results = theta.model, dict[str, Tensor]()
    head, relation, tail = _all_ids(*theta.entity.shape[:2])
    for form, triples in _forms(theta).items():
        scores, backward = model.scores(theta.entity, theta.relation, triples)
        results[f"scores in {form}"] = scores.reshape(len(theta.entity), -1).clone()
        gradients = backward(scores / 8)
        for name, gradient in zip(("entities", "relations"), gradients, strict=True):
            results[f"gradients of {name} in {form}"] = gradient
    results["score_tails"] = theta.score_tails(head, relation)
    results["score_heads"] = theta.score_heads(relation, tail)
    results["scores of relations"] = theta.score_relations(head, tail)
    if model.invertible:
        vectors = theta.entity[:, :RELATIONS]
        results["transform"] = model.transform(vectors, theta.relation)
        results["inverse"] = model.inverse(vectors, theta.relation)
    return results
