"""What scores mean: fits of slope and border, and the loss that an insertion assumes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import softplus

import isi
from isi.initializers.scale import LOGISTIC, _known_and_corrupted, fit_scale
from isi.models.losses import LOSSES, Loss, TrainingLoss, loss_named
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.init_contexts import DIMENSION, ENTITIES, TRIPLES
from tests.small_graphs import random_embedding

KNOWN = torch.tensor(TRIPLES)


def theta(name: str = "complex") -> Embedding:
    return random_embedding(1, ENTITIES, 3, DIMENSION, model=make_model(name, {}, ""))


@given(st.floats(0.2, 5.0))
@settings(max_examples=10, deadline=None)
def test_scores_of_other_units_have_the_same_log_odds(unit: float) -> None:
    one = theta("distmult")
    other = replace(one, relation=one.relation * unit)
    fit, again = (fit_scale(each, KNOWN, "margin") for each in (one, other))
    if fit.slope > 0.01:
        assert again.slope * unit == pytest.approx(fit.slope, rel=1e-3)
        assert again.offset == pytest.approx(fit.offset, abs=1e-3)


def test_corruptions_have_ends_among_all_entities() -> None:
    one = random_embedding(1, 50, 1, 4, model=make_model("distmult", {}, ""))
    one.entity[:, :4] = 0.0
    triples = torch.stack([torch.arange(4, 50), torch.zeros(46).long(), torch.arange(4, 50)], 1)
    _, wrong = _known_and_corrupted(one, triples)
    assert (wrong != 0).double().mean() > 0.8


def test_a_scale_is_fitted_better_than_chance_and_not_with_logistic_loss() -> None:
    one = theta()
    fit = fit_scale(one, KNOWN, "self-adversarial")
    right, wrong = (fit.slope * part + fit.offset for part in _known_and_corrupted(one, KNOWN))
    # known triples and their corruptions weigh the same
    assert (softplus(-right).mean() + softplus(wrong).mean()).item() / 2 <= np.log(2) + 0.05
    assert fit_scale(one, KNOWN, "logistic") == LOGISTIC
    assert fit_scale(one, KNOWN, TrainingLoss("logistic", margin=2.0)) != LOGISTIC


@pytest.mark.parametrize("loss", [*LOSSES, TrainingLoss("margin", 0.5)])
def test_insertion_knows_the_loss_that_is_named(loss: Loss | TrainingLoss) -> None:
    one = theta()
    given = one.entity[0].numpy(), one.relation[0].numpy(), [(ENTITIES, 0, 1), (2, 1, ENTITIES)]
    how = {"new": 1, "model": "complex", "known_triples": TRIPLES, "initializer": "map"}
    done = isi.insert(*given, **how, trained_with=loss)
    assert done.details.scale.training == loss_named(loss)
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
    assert {each.trained_with for each in decided.selection.trials} == {
        decided.details.scale.training.name
    }
    assert (decided.vectors == named.vectors).all()


@pytest.mark.parametrize(
    ("loss", "model", "expected"),
    [
        ("crossentropy", "DistMult", "softmax"),
        ("softplus", "DistMult", "logistic"),
        ("softplus", "TransE", "logistic"),
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
