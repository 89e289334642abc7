"""Fold-in: a step by hand, which rows move, what new rows know of each other and earlier facts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import softplus

import isi
from isi.initializers import fold_in as module
from isi.initializers.api import INITIALIZERS, InitContext
from isi.initializers.scale import Scale
from isi.insertion.engine import Method
from isi.insertion.inverses import InverseRelations, pack, unpack_first
from isi.insertion.large import insert_rows
from isi.models.bilinear import ComplEx, DistMult
from isi.models.distance import TransE
from isi.models.losses import LOSSES, Loss, loss_named
from isi.models.model import Model
from tests.init_contexts import DIMENSION, ENTITIES, RELATIONS, TRIPLES, four_novel, initialize
from tests.small_graphs import random_embedding
from tests.small_insertion import insertion as stack_of_two

#: Of ``four_novel``: places of the new entities with facts, and of the one without.
WITH, WITHOUT = [0, 1, 3], 2
FREE = {"share": 0.0, "pull": 0.0, "rate": 0.25, "epochs": 1}


def of_loss(loss: Loss, model: Model | None = None) -> InitContext:
    return replace(four_novel(model or DistMult()), scale=Scale(loss_named(loss)))


def fold(context: InitContext, **options: Any) -> Tensor:
    return initialize("fold_in", context, **{"share": 0.3, "pull": 1.0, **FREE, **options}).vectors


def alone(context: InitContext, place: int) -> InitContext:
    """The same with one new entity."""
    names = ("novel", "other", "relation", "novel_is_tail", "observed")
    changed = {name: getattr(context, name)[:, [place]] for name in names}
    return replace(context, **changed)


def graph(model: str = "distmult") -> dict[str, Any]:
    """Arguments of ``isi.insert``: two new entities without a fact between them."""
    theta = random_embedding(1, ENTITIES, RELATIONS, DIMENSION, model=DistMult())
    return {
        "entities": theta.entity[0].numpy(),
        "relations": theta.relation[0].numpy(),
        "triples": [(ENTITIES, 0, 1), (2, 1, ENTITIES), (ENTITIES + 1, 2, 5)],
        "new": 2,
        "model": model,
        "known_triples": TRIPLES,
        "initializer": "fold_in",
    }


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
def test_new_entities_depend_on_each_other_and_those_without_facts_stay(loss: Loss) -> None:
    context = of_loss(loss)
    before = context.theta0.entity.clone()
    start, together = module.start_of(context, "soft_rs").vectors, fold(context, epochs=5)
    assert torch.equal(context.theta0.entity, before)
    assert torch.equal(together[0, WITHOUT], start[0, WITHOUT])
    assert (together != start)[0, WITH].any(-1).all()
    assert not torch.allclose(fold(alone(context, 0), epochs=5)[0, 0], together[0, 0])


@pytest.mark.parametrize("constraint", ["sphere", "ball"])
def test_vectors_keep_the_constraint(constraint: Any) -> None:
    model = TransE(margin=2.0, constraint=constraint)
    vectors = fold(of_loss("margin", model), epochs=5)
    torch.testing.assert_close(vectors, model.constrain(vectors))


def test_a_doubtful_fact_moves_a_vector_less_where_it_is_held() -> None:
    context, held = alone(of_loss("softmax"), 0), {"pull": 3.0, "epochs": 40}
    start = module.start_of(context, "soft_rs").vectors
    moved = []
    for belief in (1.0, 0.1):
        confidence = torch.full(context.observed.shape, belief, dtype=torch.float64)
        vectors = fold(replace(context, start=start, confidence=confidence), **held)
        moved.append((vectors - start).norm().item())
    assert moved[1] < 0.8 * moved[0]


def test_a_fact_of_two_new_entities_counts_once() -> None:
    context = alone(of_loss("softmax"), 0)
    context = replace(
        context,
        novel=torch.tensor([[0, 5]]),
        other=torch.tensor([[[5, 1], [0, 0]]]),
        relation=torch.tensor([[[2, 0], [2, 0]]]),
        novel_is_tail=torch.tensor([[[False, True], [True, False]]]),
        observed=torch.tensor([[[True, True], [True, False]]]),
    )
    rows = module._rows(context, 0, torch.zeros(2, DIMENSION))
    known = context.known[0].nonzero()[:, 0].tolist()
    first = len(known)
    assert rows.facts.triples.tolist() == [[first, 2, first + 1], [known.index(1), 0, first]]
    assert rows.has_facts.tolist() == [True, True]


@pytest.mark.parametrize("packed", [False, True])
def test_new_relations_are_trained_too(packed: bool) -> None:
    relations = 2 * RELATIONS if packed else RELATIONS
    theta = random_embedding(1, ENTITIES, relations, DIMENSION, model=ComplEx())
    theta = pack(theta) if packed else theta
    context = replace(of_loss("softmax"), theta0=theta, new_relations=1)
    context = replace(context, start=theta.entity[:, [0, 5, 9, 11]].clone())
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
    pair = [fold(replace(each, start=start), share=1.0, epochs=3) for each in (context, moved)]
    assert torch.equal(*pair)


def test_a_stack_of_the_grid_is_inserted_the_same_up_to_rounding_by_any_number_of_threads() -> None:
    context, before, vectors = stack_of_two(), torch.get_num_threads(), []
    assert context.start is None
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


@pytest.mark.parametrize("loss", LOSSES)
def test_each_loss_lowers_its_own(loss: Loss) -> None:
    """By all known entities as wrong answers."""
    context = alone(of_loss(loss), 0)
    chosen, theta, known = loss_named(loss), context.theta0, context.known[0]
    rows = context.observed[0, 0]

    def loss_of(vector: Tensor) -> float:
        total = 0.0
        facts = zip(context.other[0, 0, rows], context.relation[0, 0, rows], strict=True)
        for other, relation in facts:  # DistMult is symmetric
            row, end = theta.relation[0, relation], theta.entity[0, other]
            right = (vector * row * end).sum()[None]
            for given in (vector, end):
                wrong = theta.entity[0, known] @ (given * row)
                if loss == "softmax":
                    total += softplus(wrong.logsumexp(0) - right).item()
                else:
                    total += (
                        chosen.of_right(right) + chosen.of_wrong(right, wrong[None]).sum(1)
                    ).item()
        return total

    start = module.start_of(context, "soft_rs").vectors[0, 0]
    assert loss_of(fold(context, epochs=20, rate=0.1)[0, 0]) < loss_of(start)


@pytest.mark.parametrize("seed", range(4))
def test_the_part_in_earlier_facts_lowers_harm(seed: int) -> None:
    """The table has learned its triples: each has one of the highest scores."""
    rng = np.random.default_rng(seed)
    entities, relations = rng.standard_normal((40, 16)), rng.standard_normal((3, 16))
    scores = np.einsum("hd,rd,td->hrt", entities, relations, entities)
    triples = np.argwhere(scores > np.quantile(scores, 0.95))
    facts = [
        (40 + new, int(rng.integers(3)), int(rng.integers(40)))
        for new in range(8)
        for _ in range(3)
    ]
    given = entities.astype(np.float32), relations.astype(np.float32), facts
    how = {"new": 8, "model": "distmult", "known_triples": triples, "trained_with": "softmax"}
    after = []
    for share in (0.0, 1.0):
        options = {"share": share, "pull": 0.0}
        done = isi.insert(*given, **how, initializer="fold_in", options=options)
        table, mrr = done.entities, list[float]()
        for head, relation, tail in triples.tolist():
            of_query = table @ (table[head] * relations[relation])
            of_query[triples[(triples[:, :2] == [head, relation]).all(1), 2]] = -np.inf
            mrr.append(1 / (1 + (of_query > scores[head, relation, tail]).sum()))
        after.append(np.mean(mrr))
    assert after[1] >= after[0]


def test_rows_of_a_table_that_is_a_file_are_those_of_insert() -> None:
    given = graph()
    expected = isi.insert(**given, trained_with="softmax")
    rows = insert_rows(**given, loss="softmax")
    np.testing.assert_allclose(rows, expected.vectors, rtol=1e-4, atol=1e-5)
    assert np.array_equal(expected.entities[:ENTITIES], given["entities"])
    further = expected.train(2)
    assert np.array_equal(further.entities[:ENTITIES], given["entities"])
    assert (further.vectors != expected.vectors).any(-1).all()


def test_a_model_without_inverse_starts_at_the_mean() -> None:
    class Plain(DistMult):
        invertible = False

    method = Method(INITIALIZERS.get("fold_in"), {"start": "soft_rs"}, "")
    assert method.start(Plain()).initializer.name == "mean"
    assert method.start(DistMult()).initializer.name == "soft_rs"
