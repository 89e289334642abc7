"""Fold-in: a step by hand, which rows move, what new rows know of each other and earlier facts."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

import isi
from isi.initializers import fold_in as module
from isi.initializers.api import INITIALIZERS
from isi.initializers.context import InitContext, NewRows
from isi.initializers.inverses import InverseRelations, pack, unpack_first
from isi.initializers.scale import Scale
from isi.insertion.engine import Method
from isi.models.bilinear import ComplEx, DistMult
from isi.models.losses import LOSSES, Loss, loss_named
from tests.init_contexts import DIMENSION, ENTITIES, RELATIONS, four_novel, initialize
from tests.small_graphs import random_embedding
from tests.small_insertion import insertion as stack_of_two

#: Of ``four_novel``: places of the new entities with facts, and of the one without.
WITH, WITHOUT = [0, 1, 3], 2
FREE = {"share": 0.0, "pull": 0.0, "rate": 0.25, "epochs": 1}


def of_loss(loss: Loss) -> InitContext:
    return replace(four_novel(DistMult()), scale=Scale(loss_named(loss)))


def fold(context: InitContext, **options: Any) -> Tensor:
    return initialize("fold_in", context, **{"share": 0.3, "pull": 1.0, **FREE, **options}).vectors


def alone(context: InitContext, place: int) -> InitContext:
    """The same with one new entity."""
    names = ("novel", "other", "relation", "novel_is_tail", "observed")
    changed = {name: getattr(context, name)[:, [place]] for name in names}
    return replace(context, **changed)


def test_the_first_step_by_hand() -> None:
    """Adagrad's first step is the rate times the sign of each gradient, here of cross-entropy."""
    context = alone(of_loss("softmax"), 1)  # one fact: (7, 1, new)
    start = module.start_of(context, "soft_rs").vectors[0, 0].double()
    known = context.theta0.entity[0, context.known[0]].double()
    given, relation = context.theta0.entity[0, 7].double(), context.theta0.relation[0, 1].double()
    vector = start.clone().requires_grad_()
    everyone = torch.cat([known, vector[None]])
    right = (given * relation * vector).sum()
    loss = (everyone @ (given * relation)).logsumexp(0) - right
    loss = loss + (everyone @ (vector * relation)).logsumexp(0) - right
    (gradient,) = torch.autograd.grad(loss, vector)
    expected = start - 0.25 * known.square().mean().sqrt() * gradient.sign()
    torch.testing.assert_close(fold(context)[0, 0].double(), expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("loss", LOSSES)
def test_new_entities_depend_on_each_other_and_those_without_facts_stay(
    loss: Loss,
) -> None:
    context = of_loss(loss)
    before = context.theta0.entity.clone()
    start, together = module.start_of(context, "soft_rs").vectors, fold(context, epochs=5)
    assert torch.equal(context.theta0.entity, before)
    assert torch.equal(together[0, WITHOUT], start[0, WITHOUT])
    assert (together != start)[0, WITH].any(-1).all()
    for other in (fold(alone(context, 0), epochs=5), fold(context, epochs=5, share=1.0)):
        assert not torch.allclose(other[0, 0], together[0, 0])


@pytest.mark.parametrize("packed", [False, True])
def test_new_relations_are_trained_too(packed: bool) -> None:
    relations = 2 * RELATIONS if packed else RELATIONS
    theta = random_embedding(1, ENTITIES, relations, DIMENSION, model=ComplEx())
    theta = pack(theta) if packed else theta
    context = replace(of_loss("softmax"), theta0=theta)
    start = theta.entity[:, [0, 5, 9, 11]].clone()
    context = replace(context, training=NewRows(start=start, relations=1))
    form = unpack_first(INITIALIZERS.get("fold_in"), theta.model)
    result = form.initialize(context, {**form.defaults, **FREE})
    assert isinstance(theta.model, InverseRelations) == packed
    assert result.relations is not None
    assert result.relations.shape == (1, 1, theta.relation.shape[-1])
    halves = (result.relations != theta.relation[:, -1:]).chunk(2, -1)
    assert all(half.any() for half in halves)


def test_hidden_entities_get_the_vectors_of_an_insertion_into_the_table_without_them() -> None:
    context = of_loss("softmax")
    known = context.known[0].nonzero()[:, 0]
    place = torch.zeros(ENTITIES, dtype=torch.int64)
    place[known] = torch.arange(len(known))
    trained = context.triples.clone()
    trained[:, [0, 2]] = place[trained[:, [0, 2]]]
    number, (_, new) = len(known), context.novel.shape
    entity = torch.cat([context.theta0.entity[:, known], torch.zeros(1, new, DIMENSION)], 1)
    order = torch.cat([known, context.novel[0]])
    moved = replace(
        context,
        theta0=replace(context.theta0, entity=entity),
        known=context.known[:, order],
        eligible=context.eligible[:, order],
        novel=number + torch.arange(new)[None],
        words=context.words[order],
        kinds=context.kinds[order],
        other=place[context.other],
        triples=trained,
    )
    start = module.start_of(context, "soft_rs").vectors
    training = NewRows(start=start)
    here = fold(replace(context, training=training), share=1.0, epochs=3)
    there = fold(replace(moved, training=training), share=1.0, epochs=3)
    assert torch.equal(here, there)


def test_a_stack_of_the_grid_is_inserted_the_same_up_to_rounding_by_any_number_of_threads() -> None:
    context, before, vectors = stack_of_two(), torch.get_num_threads(), []
    assert context.training == NewRows()
    try:
        for threads in (1, 1, 2):
            torch.set_num_threads(threads)
            vectors.append(fold(context, epochs=3))
    finally:
        torch.set_num_threads(before)
    assert torch.equal(*vectors[:2])
    torch.testing.assert_close(*vectors[1:])
    assert vectors[0].shape[:2] == context.novel.shape
    assert "stack_has_no_effect" in isi.check_initializer("fold_in")


def test_a_model_without_inverse_starts_at_the_mean() -> None:
    class Plain(DistMult):
        invertible = False

    method = Method(INITIALIZERS.get("fold_in"), {"start": "soft_rs"}, "")
    assert method.start(Plain()).initializer.name == "mean"
    assert method.start(DistMult()).initializer.name == "soft_rs"
