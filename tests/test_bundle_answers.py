"""Answers of a bundle: ranks, probabilities and calibration by hand, indicators, ablations, and spellings of names."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import isi
from isi.bundle.calibration import HeldOutCalibration, answer, fit_curve
from isi.bundle.insert import NewEntity, ablations, before, indicators, insert_entity
from isi.bundle.query import OpenBundle, Query, find, queries_of
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.insertion.platt import fit_platt
from tests.small_bundle import BETWEEN, NAMES, RELATIONS, VECTORS, WORDS, new_entity, opened, random_bundle, small

KITCHEN, BEDROOM, KETTLE, BED, TURN_ON, LIE_ON = range(6)
AT, HAS = range(2)
FACTS = [("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")]


def stove(**changed: Any) -> NewEntity:
    given: dict[str, Any] = {"name": "stove", "kind": "object", "triples": FACTS, "vector": [0.6, 0.8, 0.0]}
    return new_entity(**{**given, **changed})


# Answers


def test_answers_are_ranked_by_score_among_those_of_a_kind_that_can_answer() -> None:
    result = answer(opened(), Query(KETTLE, AT, TAIL), 5)  # rooms alone: 3 · 1 and 1 · 1
    assert [(one.entity, one.rank, one.score, one.percentile, one.known) for one in result] == [
        ("kitchen", 1, 3.0, 1.0, True), ("bedroom", 2, 1.0, 0.0, False),
    ]  # fmt: skip


def test_heads_are_predicted_too_and_indicators_with_the_answer_are_named() -> None:
    result = answer(opened(), Query(LIE_ON, HAS, HEAD), 5, indicators=[BED, KETTLE])
    assert [(one.entity, one.score, one.known) for one in result] == [("bed", 2.0, True), ("kettle", 0.0, False)]
    result = answer(opened(), Query(KETTLE, HAS, TAIL), 5, indicators=[BED, KETTLE])
    assert [(one.entity, one.shared_by) for one in result] == [("turn on", ["kettle"]), ("lie on", ["bed"])]


def test_without_kinds_all_entities_are_candidates_but_the_given_one() -> None:
    result = answer(opened(kinds=[""] * 6), Query(KETTLE, AT, TAIL), 9)
    assert [(one.entity, one.score, one.percentile) for one in result] == [
        ("bed", 5.0, 1.0), ("kitchen", 3.0, 0.75), ("bedroom", 1.0, 0.5), ("turn on", 0.0, 0.0), ("lie on", 0.0, 0.0),
    ]  # fmt: skip
    looped = np.array([[KETTLE, AT, KETTLE]])
    assert answer(opened(kinds=[""] * 6, triples=looped), Query(KETTLE, AT, TAIL), 1)[0].entity == "kettle"


def test_without_known_triples_there_is_a_percentile_but_no_probability() -> None:
    result = answer(opened(triples=np.zeros((0, 3), np.int64)), Query(KETTLE, AT, TAIL), 2)
    assert [(one.probability, one.percentile) for one in result] == [(None, 1.0), (None, 0.75)]


def test_only_fitting_queries_are_made() -> None:
    assert queries_of(opened(), KETTLE, {}) == [Query(KETTLE, AT, TAIL), Query(KETTLE, HAS, TAIL)]
    assert queries_of(opened(), KITCHEN, {BED: 1.0}) == [Query(KITCHEN, AT, HEAD)]  # as rooms do
    no_kinds = opened(kinds=[""] * 6)
    assert queries_of(no_kinds, KITCHEN, {BED: 0.05, BEDROOM: 0.95}) == [Query(KITCHEN, AT, HEAD)]
    assert queries_of(no_kinds, KITCHEN, {BED: 0.15, BEDROOM: 0.85}) == [
        Query(KITCHEN, AT, TAIL), Query(KITCHEN, AT, HEAD), Query(KITCHEN, HAS, TAIL),
    ]  # fmt: skip
    assert len(queries_of(opened(triples=np.zeros((0, 3), np.int64)), KETTLE, {BED: 1.0})) == 4


# Calibrated probabilities


def test_a_curve_through_two_scores_passes_through_their_shares() -> None:
    """For two distinct scores, the maximum-likelihood logistic curve passes through the mean target at each score."""
    scores = torch.tensor([0.0] * 4 + [1.0] * 4, dtype=torch.float64)
    known = torch.tensor([True, False, False, False, True, True, True, False])
    right, wrong = 5 / 6, 1 / 6  # Platt's targets, of four known and four others
    low, high = fit_platt(scores, known)(torch.tensor([0.0, 1.0])).tolist()
    assert low == pytest.approx((right + 3 * wrong) / 4, abs=1e-6)
    assert high == pytest.approx((3 * right + wrong) / 4, abs=1e-6)


@given(
    scores=st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=30), data=st.data(), scale=st.floats(0.01, 100)
)
def test_probabilities_rise_with_the_score_whatever_its_unit(
    scores: list[float], data: st.DataObject, scale: float
) -> None:
    known = torch.tensor(data.draw(st.lists(st.booleans(), min_size=len(scores), max_size=len(scores))))
    table = torch.tensor(scores, dtype=torch.float64)
    probabilities = fit_platt(table, known)(table)
    assert ((probabilities >= 0) & (probabilities <= 1)).all()
    ordered = probabilities[table.argsort()]
    assert (ordered.diff() >= -1e-15).all()  # equal scores may differ in the last bit, by their place in the vector
    torch.testing.assert_close(fit_platt(scale * table, known)(scale * table), probabilities, rtol=1e-3, atol=1e-4)


def test_uninformative_scores_give_the_share_of_known_answers() -> None:
    curve = fit_platt(torch.tensor([2.0, 1.0, 1.0, 0.0]).double(), torch.tensor([False, True, False, True]))
    assert curve.slope == 0.0
    assert curve(torch.tensor([5.0])).item() == pytest.approx((3 / 4 + 3 / 4 + 1 / 4 + 1 / 4) / 4)


# Indicators


@pytest.mark.parametrize("changed", [{}, {"triples": []}, {"vector": None}], ids=["both", "words", "triples"])
@pytest.mark.parametrize("name", ["soft_hybrid", "soft_es", "soft_rs"])
def test_weights_are_those_of_the_initializer(name: str, changed: dict[str, Any]) -> None:
    larger, result = insert_entity(opened(), stove(initializer=name, **changed))
    assert result.weights is not None
    expected = torch.from_numpy(result.weights[0]) @ larger.embedding.entity[0, :-1]
    np.testing.assert_allclose(result.entities[-1], expected.numpy(), rtol=1e-5, atol=1e-6)


def test_indicators_are_shown_with_how_similar_they_are() -> None:
    shown = indicators(*insert_entity(opened(), stove(initializer="es", options={"k": 2})))
    assert {one.id: (one.weight, round(one.words or 0, 4)) for one in shown} == {BED: (0.5, 0.8), LIE_ON: (0.5, 0.64)}
    places = np.array(RELATIONS) * np.array(VECTORS)[[KITCHEN, TURN_ON]]  # where each fact puts it, as 1 / 1 = 1
    for one in shown:
        vector = np.array(VECTORS[one.id])
        assert one.relations == pytest.approx((places @ vector / np.linalg.norm(vector)).mean())
    shown = indicators(*insert_entity(opened(), stove(triples=[], initializer="es", options={"k": 1})))
    assert [(one.id, one.weight, one.relations) for one in shown] == [(BED, 1.0, None)]


def test_an_insertion_is_that_of_the_library_and_leaves_what_is_known() -> None:
    given = opened()
    larger, _ = insert_entity(given, stove())
    expected = isi.insert(
        given.entities, given.relations, FACTS, new=["stove"], model="distmult", entity_names=NAMES,
        relation_names=BETWEEN, known_triples=given.triples, words=np.array([*WORDS, [0.6, 0.8, 0.0]], np.float32),
    )  # fmt: skip
    assert larger.entities.tobytes() == expected.entities.tobytes()
    assert larger.entities[:6].tobytes() == given.entities.tobytes()
    assert larger.triples.tolist()[-2:] == [[6, AT, KITCHEN], [6, HAS, TURN_ON]]
    assert larger.manifest.inserted[0].initializer == "map"


def with_stove_and_hob() -> OpenBundle:
    """The small bundle after the insertion of a stove, then of a hob with a triple that contains the stove."""
    triples = [("hob", "atLocation", "stove"), ("hob", "hasAffordance", "turn on")]
    larger, _ = insert_entity(opened(), stove())
    return insert_entity(larger, stove(name="hob", triples=triples, vector=None))[0]


def test_an_insertion_is_reproduced_whatever_came_after_it() -> None:
    both = with_stove_and_hob()
    for name, record in both.insertions().items():
        _, again = insert_entity(*before(both, record))
        assert again.entities[-1].tobytes() == both.entities[both.entity_ids[name]].tobytes()


def test_an_ablation_is_an_insertion_without_one_piece() -> None:
    both = with_stove_and_hob()
    record, own = both.insertions()["stove"], both.entities[6].astype(float)
    shown = indicators(*insert_entity(*before(both, record)))
    result = list(ablations(both, record, shown, [Query(6, AT, TAIL)], 1))
    assert [one.left_out for one in result] == ["fact", "fact", "words", *["indicator"] * len(shown)]
    fewer = insert_entity(opened(), stove(triples=FACTS[1:]))[1].entities[-1].astype(float)
    assert result[0].cosine == pytest.approx(own @ fewer / math.sqrt((own @ own) * (fewer @ fewer)))
    assert result[0].moved == pytest.approx(np.linalg.norm(own - fewer) / np.linalg.norm(own))
    named = next(one for one in result if one.left_out == "indicator")
    rest = [number for number in range(6) if NAMES[number] != named.what]
    without = isi.insert(
        small().entities[rest], small().relations,
        [fact for fact in FACTS if named.what not in fact], new=["stove"], model="distmult",
        entity_names=[NAMES[number] for number in rest], relation_names=BETWEEN,
        known_triples=[triple for triple in small().named_triples() if named.what not in triple],
        words=np.array([WORDS[number] for number in rest] + [[0.6, 0.8, 0.0]], np.float32),
    ).entities[-1].astype(float)  # fmt: skip
    assert named.moved == pytest.approx(np.linalg.norm(own - without) / np.linalg.norm(own))


def test_without_its_only_piece_nothing_is_inserted() -> None:
    larger, _ = insert_entity(opened(), stove(triples=[]))
    (result,) = ablations(larger, larger.manifest.inserted[0], [], [], 1)
    assert (result.left_out, result.initializer, result.cosine) == ("words", None, None)


# Names


@pytest.mark.parametrize("text", ["turn on", "Turn On", "turnOn", "turn_on", "turn-on", "turnon", "TURN ON"])
def test_names_are_found_without_regard_to_case_and_gaps(text: str) -> None:
    assert find(text, ["turn off", "turn on"], "ENTITY", "an entity") == "turn on"


def test_a_name_as_it_is_written_goes_first_and_none_is_guessed() -> None:
    assert find("apple", ["Apple", "apple"], "", "") == "apple"
    for text, hint in (("APPLE", "'Apple' or 'apple'"), ("aple", "'apple'"), ("zz", "'Apple' or 'apple'")):
        with pytest.raises(InputError, match=f"^ENTITY: .* got '{text}'.*{hint}"):
            find(text, ["Apple", "apple"], "ENTITY", "an entity")


# Held-out calibration


ENTITIES = 30  #: Of the random bundle.


def calibration_of(known: OpenBundle, **changed: Any) -> HeldOutCalibration:
    triples = [("new", "in", "e1"), ("e2", "on", "new")]
    given = {"name": "new", "triples": triples, "vector": np.ones(4), **changed}
    return HeldOutCalibration(*insert_entity(known, new_entity(**given)))


@pytest.fixture
def known() -> OpenBundle:
    return opened(random_bundle(120))


@pytest.mark.parametrize("changed", [
    {"initializer": "map"}, {"initializer": "map", "vector": None}, {"initializer": "rs", "options": {"k": 3}},
])  # fmt: skip
def test_held_out_entities_are_inserted_as_the_new_one_was(known: OpenBundle, changed: dict[str, Any]) -> None:
    calibration = calibration_of(known, **changed)
    assert len(calibration.held_out) == ENTITIES
    names, labels = known.entity_names, known.relation_names
    hidden = [one.entity for one in calibration.held_out[:3]]  # a tenth of them, together
    rest = known.part(np.setdiff1d(np.arange(ENTITIES), hidden))
    words = None if "vector" in changed else known.words
    for entity, vector, insert_triples in calibration.held_out[:3]:
        ends = insert_triples[:, [HEAD, TAIL]]
        assert len(ends) == (ends == entity).sum() == np.isin(ends, hidden).sum() == 2
        facts = [(names[head], labels[relation], names[tail]) for head, relation, tail in insert_triples.tolist()]
        assert set(facts) <= set(known.named_triples())
        given = {"name": names[entity], "triples": facts, "vector": None if words is None else words[entity]}
        new = new_entity(**{**changed, **given})
        alone = insert_entity(rest, new)[1].entities[-1]
        np.testing.assert_allclose(vector.numpy(), alone, rtol=1e-4, atol=1e-5)


def test_a_chosen_initializer_is_recorded_and_an_insertion_is_repeated_with_it(known: OpenBundle) -> None:
    larger, result = insert_entity(known, new_entity("new", [("new", "in", "e1")], vector=np.ones(4)))
    (record,) = larger.manifest.inserted
    assert result.choice is not None
    assert (record.initializer, record.options, record.why) == (result.initializer, result.options, result.choice.why)
    again, repeated = insert_entity(*before(larger, record))
    assert repeated.choice is None
    assert again.manifest.inserted == [record]
    assert repeated.entities.tobytes() == result.entities.tobytes()


def test_a_curve_goes_through_answers_that_are_no_insert_triples(known: OpenBundle) -> None:
    calibration, scores, right = calibration_of(known), [], []
    for entity, vector, insert_triples in calibration.held_out:
        if true := known.answers.get(Query(entity, 1, HEAD)):
            given = {head for head, relation, tail in insert_triples.tolist() if (relation, tail) == (1, entity)}
            for other in sorted(set(range(ENTITIES)) - {entity} - given):
                vectors = (known.embedding.entity[0, other], known.embedding.relation[0, 1], vector)
                scores.append(float(known.model.score(*vectors)))
                right.append(other in true)
    expected, curve = fit_platt(torch.tensor(scores).double(), torch.tensor(right)), calibration.curve(1, HEAD)
    assert curve is not None
    assert (curve.slope, curve.offset) == pytest.approx((expected.slope, expected.offset), rel=1e-3, abs=1e-4)


def test_held_out_calibration_serves_the_inserted_entity_alone(known: OpenBundle) -> None:
    calibration = calibration_of(known)
    larger = calibration.opened
    for entity, curve in ((ENTITIES, calibration.curve(0, TAIL)), (3, fit_curve(larger, 0, TAIL))):
        (best,) = answer(larger, Query(entity, 0, TAIL), 1, calibration)
        assert curve is not None
        assert best.probability == pytest.approx(curve(torch.tensor([best.score])).item())


def test_with_too_few_right_answers_a_curve_is_shared_or_missing(known: OpenBundle) -> None:
    few = replace(known, triples=np.concatenate([known.triples[known.triples[:, 1] == 0], [[3, 1, 4]]]))
    result = calibration_of(few)
    assert result.curve(1, TAIL) == result.curve(1, HEAD) is not None  # of all relations
    assert calibration_of(replace(known, triples=np.zeros((0, 3), np.int64))).curve(0, TAIL) is None


def test_where_no_entity_is_left_none_is_held_out(known: OpenBundle) -> None:
    alone = replace(known.part(np.array([1])), triples=np.array([[0, 0, 0]]))
    result = calibration_of(alone, triples=[], vector=None, initializer="mean")
    assert result.held_out == []
    assert result.curve(0, TAIL) is None
