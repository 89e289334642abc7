"""What scores mean: fits of slope and border, log Z by definition, MAP by query against SciPy."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import isi
from isi.initializers import map as maximum
from isi.initializers.api import InitContext
from isi.initializers.scale import LOGISTIC, KnownQueries, fit_scale, log_partition
from isi.insertion.engine import queries_of
from isi.models.losses import LOSSES
from isi.models.model import make_model
from isi.models.stack import Embedding, mapped
from tests.init_contexts import DIMENSION, ENTITIES, TRIPLES, four_novel, initialize
from tests.small_graphs import random_embedding

KNOWN = torch.tensor(TRIPLES)


def theta(name: str = "complex", models: int = 1) -> Embedding:
    return random_embedding(models, ENTITIES, 3, DIMENSION, model=make_model(name, {}, ""))


@given(st.floats(0.2, 5.0))
@settings(max_examples=10, deadline=None)
def test_scores_of_other_units_have_the_same_log_odds(unit: float) -> None:
    one = theta("distmult")
    other = replace(one, relation=one.relation * unit)
    fit, again = (fit_scale(each, KNOWN, "margin") for each in (one, other))
    if fit.slope > 0.01:
        assert again.slope * unit == pytest.approx(fit.slope, rel=1e-3)
        assert again.offset == pytest.approx(fit.offset, abs=1e-3)


def test_a_scale_is_fitted_better_than_chance_and_not_with_logistic_loss() -> None:
    fit = fit_scale(theta(), KNOWN, "self-adversarial")
    assert fit.log_loss is not None
    assert fit.log_loss <= np.log(2) + 0.05
    assert fit_scale(theta(), KNOWN, "logistic") == LOGISTIC


def test_log_z_is_the_log_of_the_sum_over_known_entities() -> None:
    stack = theta(models=2)
    known = torch.rand(2, ENTITIES, generator=torch.Generator().manual_seed(1)) < 0.7
    is_tail = torch.tensor([[True, False, True], [False, False, True]])
    relation, other = torch.tensor([[0, 1, 2], [2, 1, 0]]), torch.tensor([[3, 4, 0], [1, 1, 7]])
    log_z = log_partition(stack, known, is_tail, relation, other)
    for model in range(2):
        for query in range(3):
            given, row = stack.entity[model, other[model, query]], relation[model, query]
            by = stack.relation[model, row]
            scores = [
                stack.model.score(given, by, end) if is_tail[model, query]
                else stack.model.score(end, by, given)
                for end in stack.entity[model, known[model]]
            ]  # fmt: skip
            expected = torch.stack(scores).exp().sum().log()
            assert log_z[model, query].item() == pytest.approx(expected.item(), abs=1e-5)


def test_known_queries_have_the_sum_over_their_known_answers() -> None:
    one, trained = theta(), torch.ones(1, len(TRIPLES), dtype=torch.bool)
    trained[0, 1] = False
    queries = KnownQueries(one, KNOWN, trained, tails_only=False).unique
    scores = one.score(*KNOWN.T[:, None])[0]
    assert queries.answers.sum() == 2 * (len(TRIPLES) - 1)
    for place in range(len(queries.given)):
        is_tail, relation = bool(queries.novel_is_tail[place]), int(queries.relation[place])
        given = KNOWN[:, 0 if is_tail else 2] == queries.given[place]
        answers = given & (KNOWN[:, 1] == relation) & trained[0]
        assert queries.answers[0, place] == answers.sum()
        if answers.any():
            expected = scores[answers].exp().sum().log().item()
            assert queries.log_z[0, place].item() == pytest.approx(expected, abs=1e-5)


def by_query(name: str) -> InitContext:
    of = four_novel(make_model(name, {}, ""))
    scale = fit_scale(of.theta0, of.triples, "softmax")
    return replace(of, scale=scale, queries=queries_of(of.theta0, of.triples, of.trained, scale))


def plain_objective(
    of: InitContext, place: int, mean: np.ndarray, strength: float, weight: float
) -> Callable[[np.ndarray], float]:
    """The objective of MAP by query for one novel entity, fact by fact and query by query."""
    theta0 = mapped(of.theta0, Tensor.double)
    known = theta0.entity[0, of.known[0]]
    sigma = np.cov(known.numpy().T, bias=True)
    shrinkage = maximum.SHRINKAGE
    sigma = (1 - shrinkage) * sigma + shrinkage * np.trace(sigma) / len(sigma) * np.eye(len(sigma))
    number = int(of.observed[0, place].sum())
    share = min(1.0, number / (2 * len(TRIPLES) / len(known)))

    def score(v: Tensor, is_tail: bool, relation: int, end: Tensor) -> Tensor:
        row = theta0.relation[0, relation]
        ends = (end, row, v) if is_tail else (v, row, end)
        return theta0.model.score(*ends)

    def objective(vector: np.ndarray) -> float:
        v, total = torch.as_tensor(vector), 0.0
        for fact in range(number):
            is_tail = bool(of.novel_is_tail[0, place, fact])
            relation, other = int(of.relation[0, place, fact]), int(of.other[0, place, fact])
            end = theta0.entity[0, other]
            # the novel entity as answer, and as given end
            z = score(known, is_tail, relation, end).logsumexp(0)
            right = score(v, is_tail, relation, end)
            total += float(torch.nn.functional.softplus(z - right))
            total += float(score(v, is_tail, relation, known).logsumexp(0) - right)
        for is_tail in (False, True):
            given, asked = (0, 2) if is_tail else (2, 0)
            for end, relation in {(triple[given], triple[1]) for triple in TRIPLES}:
                answers = [t[asked] for t in TRIPLES if (t[given], t[1]) == (end, relation)]
                known_end = theta0.entity[0, end]
                z = score(theta0.entity[0, answers], is_tail, relation, known_end).logsumexp(0)
                crowd = torch.nn.functional.softplus(score(v, is_tail, relation, known_end) - z)
                total += weight * share * len(answers) * float(crowd)
        return total + strength / 2 * float((vector - mean) @ np.linalg.solve(sigma, vector - mean))

    return objective


@pytest.mark.parametrize("name", ["complex", "distmult"])
def test_map_by_query_is_what_a_general_minimizer_finds(name: str) -> None:
    of = by_query(name)
    options = {"prior": "mean", "strength": 0.5, "ratio": 2, "known_negatives": 0.4}
    result = initialize("map", of, word_weight=0.0, relation_weight=0.0, **options)
    mean = of.theta0.entity[0, of.known[0]].double().mean(0).numpy()
    for place in (0, 1, 3):
        plain = plain_objective(of, place, mean, 0.5, 0.8)
        best = scipy.optimize.minimize(plain, mean, method="BFGS", options={"gtol": 1e-7})
        np.testing.assert_allclose(result.vectors[0, place], best.x, atol=2e-3)


def test_a_vector_does_not_depend_on_others_that_share_the_crowd() -> None:
    of = by_query("distmult")
    options = {"prior": "mean", "strength": 0.5, "ratio": 2, "known_negatives": 0.4}
    options |= {"word_weight": 0.0, "relation_weight": 0.0}
    together = initialize("map", of, **options).vectors[0, 1]
    names = ("novel", "other", "relation", "novel_is_tail", "observed")
    alone = replace(of, **{name: getattr(of, name)[:, 1:2] for name in names})
    torch.testing.assert_close(initialize("map", alone, **options).vectors[0, 0], together)


@pytest.mark.parametrize("loss", LOSSES)
def test_insertion_knows_the_loss_that_is_named(loss: str) -> None:
    one = theta()
    given = one.entity[0].numpy(), one.relation[0].numpy(), [(ENTITIES, 0, 1), (2, 1, ENTITIES)]
    how = {"new": 1, "model": "complex", "known_triples": TRIPLES, "initializer": "map"}
    done = isi.insert(*given, **how, trained_with=loss)
    assert done.details.scale.training.name == loss
    logistic = isi.insert(*given, **how)
    assert (done.vectors == logistic.vectors).all() == (loss == "logistic")


def test_an_unknown_loss_is_decided_and_then_as_if_named() -> None:
    one = theta()
    given = one.entity[0].numpy(), one.relation[0].numpy(), [(ENTITIES, 0, 1), (2, 1, ENTITIES)]
    heads, tails = np.meshgrid(range(6), range(6, ENTITIES))
    known = [(h, (h + t) % 3, t) for h, t in zip(heads.flat, tails.flat, strict=True)]
    how = {"new": 1, "model": "complex", "known_triples": known}
    decided = isi.insert(*given, **how)
    named = isi.insert(*given, **how, trained_with=decided.details.method.trained_with)
    assert decided.selection is not None
    assert {each.trained_with for each in decided.selection.candidates} == {
        decided.details.scale.training.name
    }
    assert (decided.vectors == named.vectors).all()


@pytest.mark.parametrize(
    ("loss", "model", "expected"),
    [
        ("crossentropy", "DistMult", "softmax"),
        ("softplus", "DistMult", "logistic"),
        ("softplus", "TransE", "margin"),
        ("nssa", "TransE", "self-adversarial"),
        ("marginranking", "DistMult", "margin"),
    ],
)
def test_the_loss_of_a_model_of_pykeen_is_read(loss: str, model: str, expected: str) -> None:
    triples = pytest.importorskip("pykeen.triples")
    models = pytest.importorskip("pykeen.models")
    facts = np.array([(f"e{head}", f"r{relation}", f"e{tail}") for head, relation, tail in TRIPLES])
    factory = triples.TriplesFactory.from_labeled_triples(facts)
    trained = models.model_resolver.make(
        model, triples_factory=factory, embedding_dim=4, loss=loss, random_seed=0
    )
    facts = [("new", "r0", "e1")]
    done = isi.pykeen.insert(trained, factory, facts, new=["new"], initializer="map").rows
    assert done.details.scale.training.name == expected
