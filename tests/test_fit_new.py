"""``isi.fit_new`` trains new rows alone; nearest entities and distance in ``Inserted`` by hand."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import softplus

import isi
from isi.errors import InputError
from isi.initializers.scale import Scale
from isi.insertion.arguments import stack_of_one
from isi.insertion.engine import queries_of
from isi.insertion.inverses import both_ways, pack, unpack
from isi.insertion.new_rows import CrossEntropy, LogOdds, NewRows, held_out_facts
from isi.insertion.result import Inserted
from isi.models.bilinear import DistMult
from isi.models.distance import TransE
from isi.models.scoring import TripleList
from isi.models.stack import Embedding
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer
from tests.small_embedding import (
    BETWEEN,
    ENTITIES,
    KNOWN,
    KNOWN_TRIPLES,
    LINE,
    NAMES,
    NEW,
    TRIPLES,
    call,
    fit,
    on_a_line,
)
from tests.small_graphs import random_embedding


def margins(entities: np.ndarray, relations: np.ndarray, done: Inserted) -> np.ndarray:
    """Scores of the insert triples minus the mean score with other heads and tails."""
    stack, names = stack_of_one(entities, relations, done.model), [*KNOWN, *NEW]
    triples = [
        (names.index(head), BETWEEN.index(relation), names.index(tail))
        for head, relation, tail in TRIPLES
    ]
    head, relation, tail = torch.tensor(triples).T[:, None]
    others = stack.score_tails(head, relation).mean(-1) + stack.score_heads(relation, tail).mean(-1)
    return (stack.score(head, relation, tail) - others / 2)[0].numpy()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("known", [None, KNOWN_TRIPLES])
def test_new_rows_move_alone_and_the_others_stay_the_same_bytes(dtype: Any, known: Any) -> None:
    done = call(initializer="mean")
    given = done.entities.astype(dtype), done.relations.astype(dtype)
    before = [part.copy() for part in given]
    entities, relations = isi.fit_new(
        *given,
        TRIPLES,
        new=2,
        model=done.model,
        epochs=20,
        known_triples=known,
        early_stopping=False,
        **NAMES,
    )
    assert (entities.dtype, relations.dtype) == (dtype, dtype)
    assert entities[:ENTITIES].tobytes() == before[0][:ENTITIES].tobytes()
    assert relations.tobytes() == before[1].tobytes()
    assert [part.tobytes() for part in given] == [part.tobytes() for part in before]
    assert (entities[ENTITIES:] != before[0][ENTITIES:]).any(1).all()


def test_trained_triples_stand_out_between_new_entities_too() -> None:
    wide = random_embedding(1, ENTITIES, len(BETWEEN), 32)
    done = call(
        initializer="mean", entities=wide.entity[0].numpy(), relations=wide.relation[0].numpy()
    )
    before, after = (
        margins(done.entities, done.relations, done),
        margins(*fit(done, epochs=200), done),
    )
    assert after.mean() > before.mean() + 1
    alone = fit(done, TRIPLES[:3], epochs=50)
    assert not np.array_equal(alone[0], fit(done, epochs=50)[0])


def test_all_rows_move_afterwards_if_asked() -> None:
    done = call(initializer="mean")
    first, _ = fit(done, known_triples=KNOWN_TRIPLES)
    entities, relations = fit(done, known_triples=KNOWN_TRIPLES, all_epochs=5)
    assert not np.array_equal(entities[:ENTITIES], first[:ENTITIES])
    assert not np.array_equal(relations, done.relations)
    straight, _ = fit(done, known_triples=KNOWN_TRIPLES, epochs=0, all_epochs=5)
    assert not np.array_equal(straight[:ENTITIES], done.entities[:ENTITIES])


def test_the_seed_alone_decides() -> None:
    done = call()
    one, same = (fit(done, batch_size=2, seed=3) for _ in range(2))
    np.testing.assert_array_equal(one[0], same[0])
    assert not np.array_equal(one[0], fit(done, batch_size=2, seed=4)[0])


# The report of an insertion, by hand


def test_the_nearest_known_and_the_distance_from_their_cloud() -> None:
    (own,) = on_a_line().report(nearest=3)
    assert sorted(own.nearest) == [(0, 1.0), (1, 1.0), (2, 1.0)]  # of the same sign
    assert own.distance == 0  # the mean, in deviations
    assert own.farther_than == 0
    assert (own.insert_triples, own.between, own.fallback) == (1, 0, None)
    far = isi.insert(**LINE, triples=[(4, 0, 3)], new=1, initializer="neighbour_mean").report()[0]
    assert far.distance == pytest.approx(4.5 / np.std([1, 2, 3, -4]))
    assert far.farther_than == 0.75  # -4 itself lies as far


def test_a_result_shows_itself_in_five_lines_and_its_report_as_a_frame() -> None:
    shown = repr(call(initializer="mean")).splitlines()
    assert len(shown) <= 5
    assert all(len(line) <= 120 for line in shown)
    for text in (
        "2 new",
        "12 known",
        "3 triples",
        "cup, mug",
        "mean, as named",
        "nearest to cup: ",
    ):
        assert text in "\n".join(shown)
    done = on_a_line()
    (own,), frame = done.report(nearest=2), done.to_frame(nearest=2)
    assert frame.to_dict("records") == [vars(own)]
    assert (
        len(
            repr(
                isi.insert(
                    np.ones((30, 2)),
                    np.ones((1, 2)),
                    [],
                    new=100,
                    model="distmult",
                    initializer="mean",
                )
            )
        )
        < 500
    )


@pytest.mark.parametrize("apart", [0.0, 2e-6])  # a few steps of single precision
def test_coordinates_in_which_all_known_are_the_same_count_for_no_distance(apart: float) -> None:
    known = np.array([[1, 7], [2, 7], [3, 7], [-4, 7 + apart]])
    given: dict[str, Any] = {
        "model": "distmult",
        "triples": [(4, 0, 1)],
        "new": 1,
        "initializer": "xavier",
    }
    done = isi.insert(known, np.ones((1, 2)), **given)
    own = done.report()[0].distance
    assert own == pytest.approx(abs(done.entities[4, 0] - 0.5) / np.std([1, 2, 3, -4]), rel=1e-5)
    (same,) = isi.insert(
        np.ones((3, 2)), np.ones((1, 2)), **(given | {"triples": [(3, 0, 1)]})
    ).report()
    assert same.distance == 0


def test_transe_with_the_norm_of_city_blocks() -> None:
    entities = np.array([[1.0, 2.0], [0.0, 0.0], [-1.0, 3.0]], np.float32)
    options: dict[str, Any] = {"new": 1, "model": "transe_l1", "model_options": {"margin": 4.0}}
    triples, relations = [(0, 0, 3), (1, 1, 3)], np.array([[1.0, -1.0], [2.0, 1.0]], np.float32)
    done = isi.insert(entities, relations, triples, initializer="er_avg", **options)
    np.testing.assert_array_equal(done.entities[3], [2.0, 1.0])  # where both put it
    stack = done.embedding
    assert stack.score(
        torch.tensor([[0, 2]]), torch.tensor([[0, 1]]), torch.tensor([[3, 3]])
    ).tolist() == [[4.0, 0.0]]
    how = {"epochs": 5, "early_stopping": False}
    learned, _ = isi.fit_new(done.entities, relations, triples, **how, **options)
    assert learned[:3].tobytes() == entities.tobytes()
    assert (learned[3] != done.entities[3]).any()


@dataclass(frozen=True)
class Short(DistMult):
    """A user's model: no coordinate of a new entity is above a fifth."""

    def constrain(self, vectors: torch.Tensor) -> torch.Tensor:
        return vectors.clamp(-0.2, 0.2)


@pytest.mark.parametrize("initializer", ["mean", "map", "ridge", None])
def test_a_constraint_of_a_users_own_holds_for_new_rows(initializer: str | None) -> None:
    """Every function that computes new rows keeps them under the constraint, as the hidden ones."""
    wide = random_embedding(1, ENTITIES, len(BETWEEN), 4)
    given = {
        "entities": (9 * wide.entity[0]).clamp(-0.5, 0.5).numpy(),
        "relations": 9 * wide.relation[0].numpy(),
    }
    model, known = Short(), list(KNOWN_TRIPLES)
    done = call(**given, model=model, initializer=initializer, known_triples=known, budget=20)
    new = torch.from_numpy(done.entities[ENTITIES:])
    assert torch.equal(model.constrain(new), new)
    if initializer == "map":
        free = call(**given, model=DistMult(), initializer="map")
        assert (np.abs(free.entities[ENTITIES:]) > 0.2).any()
    hidden = done.hide()
    if hidden is not None:
        inserted = hidden.insert(done.method.initializer, done.options)
        assert inserted is not None
        assert torch.equal(model.constrain(inserted[1]), inserted[1])
    fitted, _ = isi.fit_new(
        done.entities, done.relations, TRIPLES, new=2, model=model, epochs=50, **NAMES
    )
    rows = torch.from_numpy(fitted[ENTITIES:])
    assert torch.equal(model.constrain(rows), rows)
    assert fitted[:ENTITIES].tobytes() == done.entities[:ENTITIES].tobytes()


# Other losses, and when to stop


def new_rows(theta: Embedding, known: np.ndarray, scale: Scale) -> NewRows:
    """The last row of an embedding as a new entity."""
    number = theta.entity.shape[1] - 1
    settings = {"batch_size": 4, "learning_rate": 0.1, "weight_decay": 0.0, "max_epochs": 1}
    of_known = replace(theta, entity=theta.entity[:, :number])
    triples = torch.from_numpy(known)
    everything = torch.ones(1, len(known), dtype=torch.bool)
    return NewRows(
        theta,
        number,
        known,
        scale,
        Optimizer(**settings),
        Negatives(mode="sampled", ratio=1, head_pool="all"),
        0,
        queries_of(of_known, triples, everything, scale),
    )


@pytest.mark.parametrize("inverse", [False, True])
def test_the_gradient_of_cross_entropy_is_that_of_its_sum(inverse: bool) -> None:
    """Written out query by query, with all answers that known queries have."""
    theta = random_embedding(1, 5, 2, 8)
    if inverse:
        wide = random_embedding(1, 5, 4, 8)
        theta = pack(replace(theta, relation=wide.relation))
    known = np.array([[0, 0, 1], [0, 0, 2], [3, 1, 2], [1, 1, 0], [2, 0, 3]])
    facts = np.array([[4, 0, 1], [3, 1, 4]])
    rows = new_rows(theta, known, Scale("softmax"))
    assert rows.queries is not None
    loss = CrossEntropy.of(rows, both_ways_if(inverse, facts), rows.queries)
    every = np.arange(len(loss.triples))
    gradient = loss.gradient(unpack(theta), every)

    new = theta.entity[0, 4].clone().requires_grad_()
    entity = torch.cat([theta.entity[0, :4], new[None]])[None]
    whole = replace(theta, entity=entity)
    share = 2 / (2 * 5 / 4)  # facts by mean triples of a known entity
    total = torch.zeros(())
    tails = {(0, 0): [1, 2], (3, 1): [2], (1, 1): [0], (2, 0): [3]}
    heads = {(0, 1): [0], (0, 2): [0], (1, 2): [3], (1, 0): [1], (0, 3): [2]}
    for head, relation, tail in facts.tolist():
        ids = torch.tensor([[head]]), torch.tensor([[relation]]), torch.tensor([[tail]])
        for scores, answer in (
            (whole.score_tails(*ids[:2])[0, 0], tail),
            (whole.score_heads(*ids[1:])[0, 0], head),
        ):
            total = total + scores.logsumexp(0) - scores[answer]
    for (given, relation), answers in tails.items():
        scores = whole.score_tails(torch.tensor([[given]]), torch.tensor([[relation]]))[0, 0]
        log_z = scores[answers].detach().logsumexp(0)
        total = total + share * len(answers) * softplus(scores[4] - log_z)
    for (relation, given), answers in heads.items():
        scores = whole.score_heads(torch.tensor([[relation]]), torch.tensor([[given]]))[0, 0]
        log_z = scores[answers].detach().logsumexp(0)
        total = total + share * len(answers) * softplus(scores[4] - log_z)
    total.backward()  # type: ignore[no-untyped-call]
    torch.testing.assert_close(gradient[0, 0], new.grad, rtol=1e-4, atol=1e-5)


def both_ways_if(inverse: bool, triples: np.ndarray) -> np.ndarray:
    return both_ways(torch.from_numpy(triples)).numpy() if inverse else triples


def test_log_odds_have_the_gradient_of_slope_and_border() -> None:
    theta = random_embedding(1, 4, 2, 6, model=TransE(margin=1.0))
    model = LogOdds(theta.model, 2.5, -0.5)
    triples = TripleList((1, 2, 4), *torch.tensor([[0, 0], [0, 3], [1, 0], [2, 1]]))
    entity = theta.entity.clone().requires_grad_()
    head, relation, tail = triples.head[None], triples.relation[None], triples.tail[None]
    scores = Embedding(entity, theta.relation, theta.model).score(head, relation, tail)
    (expected,) = torch.autograd.grad((2.5 * scores - 0.5).square().sum() / 2, entity)
    odds, backward = model.scores(theta.entity, theta.relation, triples)
    torch.testing.assert_close(odds, 2.5 * scores.detach()[0] - 0.5)
    torch.testing.assert_close(backward(odds)[0], expected)


@pytest.mark.parametrize("loss", ["softmax", "margin", "logistic"])
def test_every_loss_pulls_new_entities_to_their_facts(loss: Any) -> None:
    wide = random_embedding(1, ENTITIES, len(BETWEEN), 32)
    tables = {"entities": wide.entity[0].numpy(), "relations": wide.relation[0].numpy()}
    done = call(initializer="mean", **tables)
    how: dict[str, Any] = {"known_triples": KNOWN_TRIPLES, "loss": loss, "epochs": 60}
    fitted = fit(done, **how)
    assert fitted[0][:ENTITIES].tobytes() == done.entities[:ENTITIES].tobytes()
    assert margins(*fitted, done).mean() > margins(done.entities, done.relations, done).mean() + 0.5


def test_a_start_that_cannot_be_bettered_stays() -> None:
    """All facts rank first already, and nothing else is to be learned."""
    entities = np.array([[9.0], [9.0], [9.0], [-9.0], [9.0]], np.float32)
    alike = [0, 1, 2, 4]
    triples = [(head, 0, tail) for head in alike for tail in alike]
    given: dict[str, Any] = {
        "triples": [triple for triple in triples if 4 in triple],
        "known_triples": [triple for triple in triples if 4 not in triple],
        "new": 1,
        "model": "distmult",
        "epochs": 5,
    }
    relations = np.ones((1, 1), np.float32)
    fitted, _ = isi.fit_new(entities, relations, **given)
    np.testing.assert_array_equal(fitted, entities)
    moved, _ = isi.fit_new(entities, relations, early_stopping=False, **given)
    assert moved[4] != entities[4]


def test_vectors_stay_where_no_fact_can_be_held_out() -> None:
    """Training on one or two facts of an entity would make its vector worse."""
    done = call(initializer="mean")
    for triples in (TRIPLES[:1], TRIPLES[:2]):
        fitted, _ = fit(done, triples, early_stopping=True)
        assert fitted.tobytes() == done.entities.tobytes()


def test_one_fact_of_each_entity_with_three_is_held_out() -> None:
    triples = np.array([(5, 0, 0), (1, 0, 5), (5, 1, 2), (6, 0, 0), (6, 0, 1), (5, 0, 6)])
    for seed in range(5):
        mask = held_out_facts(triples, 5, seed)
        assert mask.sum() == 1
        assert mask[:3].any()
    assert len({int(held_out_facts(triples, 5, seed).argmax()) for seed in range(20)}) == 3


def test_what_a_loss_needs_is_said() -> None:
    done = call(initializer="mean")
    for wrong in ({"loss": "softmax"}, {"loss": "hinge"}, {"loss": "softmax", "all_epochs": 2}):
        with pytest.raises(InputError, match=r"argument '(loss|known_triples|all_epochs)'"):
            fit(done, **({"known_triples": None} | wrong))
