"""Probabilities of a home that was trained here: which facts a model loses, the candidates that its
curves are fitted to, the fits, and what told facts and training again make of them.
"""

from collections import defaultdict
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

import isi
from isi.evaluation.platt import NEARNESS, PlattCurve, fit_platt
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.home.answers import STATES, state_of
from isi.home.calibration import Hidden, Sample, fitted, losing
from isi.home.home import Home
from isi.home.loaded import LoadedEmbedding
from isi.models.bilinear import ComplEx
from isi.models.stack import Embedding
from isi.training.held_out import groups_of, with_few_facts
from tests.documented import DOCS
from tests.small_bundle import random_bundle
from tests.small_graphs import random_graph
from tests.small_home import KNOWN, quick_choices

EXAMPLES = DOCS.parent / "examples"


@given(st.integers(0, 2**32), st.integers(1, 5), st.integers(1, 6))
def test_entities_lose_all_but_a_few_facts_and_no_name_is_lost(
    seed: int, facts: int, number: int
) -> None:
    graph, rng = random_graph(12, 3, 60), np.random.default_rng(seed)
    entities = rng.permutation(12)[:number]
    groups = groups_of(graph, [[0, 1, 2]])
    stays = with_few_facts(graph, groups, entities, np.full(number, facts), rng)
    assert (stays == stays[groups]).all()
    triples = graph.triples.numpy()
    ends = triples[:, [HEAD, TAIL]]
    assert stays[~np.isin(ends, entities).any(1)].all()
    left = np.bincount(ends[stays].ravel(), minlength=12)
    assert left.all()
    assert set(triples[stays, RELATION]) == {0, 1, 2}
    before = np.bincount(ends.ravel(), minlength=12)
    assert (left >= np.minimum(facts, before))[entities].all()


def test_what_is_left_of_an_entity_is_of_few_relations() -> None:
    """An entity of two relations keeps facts of one, whichever comes last."""
    graph = random_graph(12, 3, 60)
    triples = graph.triples.clone()
    triples[:, 0], triples[:, 2] = triples[:, 0] % 6, 6 + triples[:, 2] % 6
    graph = replace(graph, triples=triples)
    relations = set()
    for seed in range(9):
        rng = np.random.default_rng(seed)
        stays = with_few_facts(graph, np.arange(60), np.array([0]), np.array([1]), rng)
        left = triples[stays & (triples[:, 0] == 0).numpy()]
        assert len(left) == 1
        relations |= set(left[:, RELATION].tolist())
    assert len(relations) > 1


def test_a_tenth_of_the_entities_at_most_loses_facts_at_a_time_and_none_twice() -> None:
    number = np.array([0, 1, *[4] * 78])
    lists = losing(number, np.random.default_rng(0))
    assert [len(entities) for entities in lists] == [10] * 5
    every = np.concatenate(lists)
    assert len(set(every)) == 50
    assert every.min() > 1
    assert losing(np.array([1, 1]), np.random.default_rng(0)) == []


def logistic(parameters: np.ndarray, scores: np.ndarray, target: np.ndarray) -> float:
    logit = parameters[0] * scores + parameters[1]
    return float((np.logaddexp(0, logit) - target * logit).sum())


def test_a_curve_near_another_one_is_the_minimum_of_loss_and_distance() -> None:
    rng = np.random.default_rng(0)
    scores, near = rng.normal(2, 3, 30), PlattCurve(0.7, -2.0)
    right = rng.random(30) < near(scores)
    target = np.where(right, (right.sum() + 1) / (right.sum() + 2), 1 / ((~right).sum() + 2))
    centre, spread = scores.mean(), scores.std()

    def loss(parameters: np.ndarray) -> float:
        """The coefficients of (score - centre) / spread and of 1 are penalized."""
        moved = parameters - [near.slope, near.offset]
        distance = (moved[0] * spread) ** 2 + (moved[1] + moved[0] * centre) ** 2
        return logistic(parameters, scores, target) + NEARNESS / 2 * distance

    curve = fit_platt(scores, right, near)
    best = minimize(loss, [0.0, 0.0], tol=1e-10).x
    assert [curve.slope, curve.offset] == pytest.approx(best, rel=1e-3)
    alone = fit_platt(scores, right)
    assert abs(alone.slope - near.slope) > abs(curve.slope - near.slope)


def test_the_state_of_a_query_is_what_is_known_of_it_and_of_its_entity() -> None:
    states = [state_of(facts, has) for facts, has in ((9, False), (4, True), (5, True))]
    assert tuple(states) == STATES


def sample(state: str, relation: int, right: int, wrong: int) -> Sample:
    """Candidates of equal scores."""
    is_right = np.arange(right + wrong) < right
    return Sample(state, relation, np.ones(len(is_right)), is_right)


def test_equal_scores_have_the_share_that_is_right_by_state_and_relation() -> None:
    samples = [sample("0", 0, 200, 200), sample("0", 1, 100, 300), sample("1", 0, 40, 360)]
    curves = fitted(samples)
    assert curves is not None
    assert curves.keys() == set(STATES)
    shares = {
        (state, relation): PlattCurve(*curves[state][relation])(np.ones(1))[0]
        for state, relation in (("0", "0"), ("0", "1"), ("0", "all"), ("1", "0"), ("5", "all"))
    }
    # Platt's targets move shares a little
    expected = {("0", "0"): 0.5, ("0", "1"): 0.25, ("0", "all"): 0.375, ("1", "0"): 0.1}
    for key, share in expected.items():
        assert shares[key] == pytest.approx(share, abs=0.01)
    assert shares["5", "all"] == pytest.approx(340 / 1200, abs=0.01)
    assert fitted([sample("0", 0, 4, 400)]) is None


def hidden(known: np.ndarray) -> Hidden:
    """A home that lost all but some of its triples, with a model of random vectors."""
    whole = LoadedEmbedding(**vars(replace(random_bundle(90), words=None)))
    rng = np.random.default_rng(1)
    entity, relation = (
        torch.from_numpy(rng.normal(size=(1, *table.shape)).astype(np.float32))
        for table in (whole.entities, whole.relations)
    )
    return Hidden(whole, known, Embedding(entity, relation, ComplEx()))


def test_candidates_are_all_unknown_answers_to_queries_that_have_some() -> None:
    known = np.arange(90) % 3 > 0
    lost = hidden(known)
    triples = lost.whole.triples
    every, left = set(map(tuple, triples.tolist())), set(map(tuple, triples[known].tolist()))
    numbers = np.bincount(triples[known][:, [HEAD, TAIL]].ravel(), minlength=30)
    expected = []
    for entity, relation, slot in product((3, 7), (0, 1), (HEAD, TAIL)):
        answers = [
            (entity, relation, other) if slot == TAIL else (other, relation, entity)
            for other in range(30)
        ]
        if not every & set(answers):
            continue
        state = state_of(int(numbers[entity]), bool(left & set(answers)))
        loop = (entity, relation, entity)
        unknown = [fact for fact in answers if fact not in left and fact != loop]
        expected.append((state, relation, len(unknown), sum(fact in every for fact in unknown)))
    samples = [
        (each.state, each.relation, len(each.scores), int(each.right.sum()))
        for each in lost.samples([3, 7])
    ]
    assert samples == expected


def home_of(left: list[str]) -> tuple[Home, pd.DataFrame]:
    """The home of the examples without some objects, and their facts."""
    frame = pd.read_csv(EXAMPLES / "home.csv")[["head", "relation", "tail"]].drop_duplicates()
    kinds = pd.read_csv(EXAMPLES / "home_kinds.csv")
    is_left = frame["head"].isin(left)
    home = isi.train(
        frame[~is_left].to_numpy().tolist(),
        kinds=dict(kinds[~kinds["entity"].isin(left)].to_numpy().tolist()),
        dimension=50,
    )
    return home, frame[is_left]


def reliability(home: Home, facts: pd.DataFrame) -> dict[str, float]:
    """Mean probability, share that is true, and Brier score of all answers about what was not
    told.
    """
    right = defaultdict[tuple[str, str], set[str]](set)
    for head, relation, tail in facts.to_numpy().tolist():
        right[head, relation].add(tail)
    pairs = [
        (each.probability, each.entity in tails)
        for (head, relation), tails in right.items()
        if relation != "atLocation"
        for each in home.ask(head, relation, top=99).answers
    ]
    probabilities, truths = np.array(pairs, float).T
    brier = ((probabilities - truths) ** 2).mean()
    return {"mean": probabilities.mean(), "true": truths.mean(), "brier": brier}


def test_probabilities_of_told_objects_are_honest_before_and_after_training() -> None:
    objects = ["statue", "egg", "television", "alarm clock", "mug", "house plant", "ladle"]
    home, facts = home_of(objects)
    told = facts[facts["relation"] == "atLocation"]
    home.tell(told.to_numpy().tolist())
    before = reliability(home, facts)
    home.train(dimension=50)
    assert home.inserted == {}
    after = reliability(home, facts)
    for measured in (before, after):
        assert measured["mean"] == pytest.approx(measured["true"], abs=0.1)
        # better than the share for each answer
        assert measured["brier"] < measured["true"] * (1 - measured["true"])
    assert after["brier"] < before["brier"] + 0.01


def test_a_known_answer_has_the_confidence_of_its_fact() -> None:
    def probability(*query: Any) -> float | None:
        return home.ask(*query).answers[0].probability

    with quick_choices():
        home = Home(KNOWN)
        head, relation, tail = KNOWN.named_triples()[0]
        assert probability(head, relation) == 1.0
        home.tell([("mug", "in", "e0")], confidence=0.9)
        assert probability("mug", "in") == 0.9
        assert probability(None, "in", "e0") == 0.9
        assert probability("mug", None, "e0") == 0.9
        home.tell([("mug", "in", "e0"), (head, relation, tail)], confidence=0.4)
        assert probability("mug", "in") == 0.4
        assert probability("mug", None, "e0") == 0.4
        by_name = {each.entity: each for each in home.ask(head, relation, top=99).answers}
        assert by_name[tail].probability == 0.4


def test_a_graph_with_too_few_facts_has_no_curves() -> None:
    home = isi.train([("cup", "in", "kitchen"), ("bed", "in", "bedroom")], dimension=4)
    assert (home.base.manifest.curves, home.base.manifest.inserted_curves) == (None, None)
