"""Answers of a bundle by hand: ranks, marks and probabilities, queries that fit, and kinds."""

from dataclasses import replace

import numpy as np
import pytest

from isi.evaluation.platt import PlattCurve, fit_platt
from isi.graph.graph import HEAD, TAIL
from isi.home.answers import LIKELY, Answer, Answers, answer, answer_relation, fit_curve
from isi.home.loaded import Query
from tests.small_bundle import TRIPLES, opened

KITCHEN, BEDROOM, KETTLE, BED, TURN_ON, LIE_ON = range(6)
AT, HAS = range(2)
NONE = np.zeros((0, 3), np.int64)
NO_KINDS = [""] * 6


def test_answers_are_ranked_by_score_among_those_of_a_kind_that_can_answer() -> None:
    result = answer(opened(), Query(KETTLE, AT, TAIL), 5, None)  # rooms alone: 3 · 1 and 1 · 1
    assert result.query == ("kettle", "atLocation", "?")
    assert [
        (one.entity, one.rank, one.score, one.known, one.probability) for one in result.answers
    ] == [
        ("kitchen", 1, 3.0, True, 1.0),
        ("bedroom", 2, 1.0, False, None),
    ]


def test_heads_are_predicted_too() -> None:
    heads = answer(opened(), Query(LIE_ON, HAS, HEAD), 5, None).answers
    assert [(one.entity, one.score, one.known) for one in heads] == [
        ("bed", 2.0, True),
        ("kettle", 0.0, False),
    ]


def test_without_kinds_all_entities_are_candidates_but_the_given_one() -> None:
    result = answer(opened(kinds=NO_KINDS, triples=NONE), Query(KETTLE, AT, TAIL), 9, None).answers
    assert [(one.entity, one.score) for one in result] == [
        ("bed", 5.0),
        ("kitchen", 3.0),
        ("bedroom", 1.0),
        ("turn on", 0.0),
        ("lie on", 0.0),
    ]
    looped = opened(kinds=NO_KINDS, triples=np.array([[KETTLE, AT, KETTLE]]))
    assert answer(looped, Query(KETTLE, AT, TAIL), 1, None).answers[0].entity == "kettle"


def test_one_odd_fact_is_an_answer_and_admits_no_other_of_its_kind() -> None:
    names, kinds = [f"e{row}" for row in range(40)], ["object"] * 30 + ["room"] * 10
    triples = np.array([[row, AT, 30 + row % 10] for row in range(29)])
    vectors = np.random.default_rng(0).normal(size=(40, 4)).astype(np.float32)
    about = {"entities": vectors, "entity_names": names, "kinds": kinds, "phrases": names}
    home = opened(**about, triples=triples, words=None)
    rooms = list(range(30, 40))
    assert home.candidates(AT, TAIL).tolist() == rooms
    # two facts of one entity
    odd = replace(home, triples=np.vstack([triples, [[29, AT, 3], [29, AT, 4]]]))
    assert odd.candidates(AT, TAIL).tolist() == rooms
    assert sorted(odd.ranked(Query(29, AT, TAIL))[0].tolist()) == [3, 4, *rooms]
    assert sorted(odd.ranked(Query(5, AT, TAIL))[0].tolist()) == rooms
    likely = PlattCurve(0.0, 5.0)
    given = answer(replace(odd, added=2), Query(29, AT, TAIL), 5, likely)
    assert given.sure
    assert {each.entity for each in given.answers if each.given} == {"e3", "e4"}
    assert not answer(odd, Query(33, AT, TAIL), 5, likely).sure  # one odd triple is not usual
    usual = replace(home, triples=np.vstack([odd.triples, [[28, AT, 3]]]))
    assert usual.candidates(AT, TAIL).tolist() == list(range(40))


def test_given_facts_stand_first_then_known_ones_and_keep_the_rank_of_their_score() -> None:
    triples = np.array([*TRIPLES, (KETTLE, AT, BEDROOM), (KETTLE, AT, TURN_ON)])
    more = replace(opened(kinds=NO_KINDS, triples=triples), added=1)
    result = answer(more, Query(KETTLE, AT, TAIL), 4, None).answers
    assert [(one.entity, one.rank, one.given, one.known) for one in result] == [
        ("turn on", 4, True, True),
        ("kitchen", 2, False, True),
        ("bedroom", 3, False, True),
        ("bed", 1, False, False),
    ]


def test_relations_between_two_entities_are_given_then_known_then_the_most_probable() -> None:
    curves = [lambda scores: scores / 10, lambda scores: scores / 4]
    both = opened(kinds=NO_KINDS)  # f(kettle, r, bed) = 3 + 2 and 2 · 0
    result = answer_relation(both, KETTLE, BED, 9, curves.__getitem__)
    assert result.query == ("kettle", "?", "bed")
    assert [(one.entity, one.rank, one.score, one.probability) for one in result.answers] == [
        ("atLocation", 1, 5.0, 0.5),
        ("hasAffordance", 2, 0.0, 0.0),
    ]
    odd = replace(both, triples=np.array([*TRIPLES, (KETTLE, HAS, BED)]), added=1)
    (first,) = answer_relation(odd, KETTLE, BED, 1, curves.__getitem__).answers
    assert (first.entity, first.rank, first.given, first.known) == ("hasAffordance", 2, True, True)
    fitting = answer_relation(opened(), KETTLE, KITCHEN, 9, lambda _: np.ones_like).answers
    assert [(one.entity, one.probability) for one in fitting] == [
        ("atLocation", 1.0),
        ("hasAffordance", 0.0),
    ]


BED_AS_ANSWER = Answer("bed", 1, 2.0, LIKELY, given=False, known=False, inserted=False)


def test_answers_are_sure_if_one_is_known_or_likely_or_there_are_no_probabilities() -> None:
    unlikely = replace(BED_AS_ANSWER, probability=LIKELY - 0.01)
    for sure, *rows in (
        (True, unlikely, BED_AS_ANSWER),
        (False, unlikely),
        (True, replace(unlikely, known=True)),
        (True, replace(unlikely, probability=None)),
        (False,),
    ):
        assert Answers(("kettle", "atLocation", "?"), rows).sure is sure


@pytest.mark.parametrize("likely", [PlattCurve(0.0, 5.0), None])
@pytest.mark.parametrize(
    ("query", "sensible"),
    [
        (Query(KETTLE, AT, TAIL), True),
        (Query(TURN_ON, AT, TAIL), False),
        (Query(TURN_ON, AT, HEAD), False),
        (Query(KITCHEN, HAS, TAIL), False),
        (Query(KITCHEN, AT, HEAD), True),
        (Query(BED, HAS, HEAD), False),
    ],
)
def test_what_no_known_triple_asks_of_a_kind_has_no_sure_answer(
    query: Query, sensible: bool, likely: PlattCurve | None
) -> None:
    assert answer(opened(), query, 5, likely).sure is sensible
    assert answer(opened(kinds=NO_KINDS), query, 5, likely).sure
    assert answer(opened(triples=NONE), query, 5, likely).sure


def test_between_kinds_that_no_known_triple_joins_no_relation_is_sure() -> None:
    pairs = {(KETTLE, KITCHEN): True, (TURN_ON, KITCHEN): False, (BED, KETTLE): False}
    for ends, sensible in pairs.items():
        best = answer_relation(opened(), *ends, 5, lambda _: PlattCurve(0.0, 5.0))
        assert best.sure is sensible


# Kinds


def test_the_kind_of_a_new_entity_is_the_one_with_the_largest_shares_of_its_facts_slots() -> None:
    """Heads of atLocation are two objects and a room; of hasAffordance, a room:
    2/3 against 1/3 + 1.
    """
    odd = opened(triples=np.array([*TRIPLES[:2], (KITCHEN, AT, BEDROOM), (BEDROOM, HAS, TURN_ON)]))
    at, has = ("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")
    assert [
        odd.kind_of("stove", facts, None)[0] for facts in ([at], [has], [at, has], [*[at] * 4, has])
    ] == [
        "object",
        "room",
        "room",
        "object",
    ]
    assert odd.kind_of("hall", [("bed", "atLocation", "hall")], None)[0] == "room"


@pytest.mark.parametrize("like", [KITCHEN, BEDROOM, BED])
def test_of_the_kinds_that_a_fact_allows_the_words_tell_one(like: int) -> None:
    """Tails of atLocation are two rooms and the bed, heads are objects."""
    home = opened(triples=np.array([*TRIPLES, (KETTLE, AT, BED)]))
    cosines = np.eye(6)[like] + 2 * np.eye(6)[TURN_ON]  # what is more alike is no tail
    assert home.kind_of("hall", [("kettle", "atLocation", "hall")], cosines)[0] == home.kinds[like]
    assert home.kind_of("hall", [("hall", "atLocation", "kitchen")], cosines)[0] == "object"


def test_without_facts_of_use_the_kind_is_that_of_the_most_similar_words() -> None:
    like_bed, like_turn_on = np.eye(6)[[BED, TURN_ON]]
    kind, reason = opened().kind_of("stove", [], like_bed)
    assert (kind, "stove" in reason, "bed" in reason) == ("object", True, True)
    fact = ("stove", "atLocation", "kitchen")
    assert opened(triples=NONE).kind_of("stove", [fact], like_turn_on)[0] == "affordance"
    assert opened().kind_of("stove", [], None) == ("", "")
    assert opened(kinds=NO_KINDS).kind_of("stove", [fact], like_bed) == ("", "")


def test_a_fact_unlike_all_that_is_known_of_its_relation_is_noted() -> None:
    odd = [("stove", "atLocation", "lie on"), ("kitchen", "hasAffordance", "stove")]
    first, second = opened().kind_notes(odd, "stove")
    assert all(word in first for word in ("atLocation", "tail", "affordance", "lie on"))
    assert all(word in second for word in ("hasAffordance", "head", "room", "kitchen"))
    for bundle in (opened(kinds=NO_KINDS), opened(triples=NONE)):
        assert not list(bundle.kind_notes(odd, "stove"))
    assert not list(opened().kind_notes([("stove", "atLocation", "kitchen")], "stove"))


# Probabilities


def test_the_curve_of_a_relation_goes_through_all_candidate_answers_about_known_entities() -> None:
    scores, known = (
        np.array([3.0, 1.0, 1.0, 2.0]),
        np.array([True, False, False, True]),
    )
    # kettle, bed in kitchen, bedroom
    expected, curve = fit_platt(scores, known), fit_curve(opened(), AT, TAIL)
    assert curve is not None
    assert (curve.slope, curve.offset) == pytest.approx((expected.slope, expected.offset), rel=1e-6)
    assert fit_curve(opened(triples=NONE), AT, TAIL) is None
