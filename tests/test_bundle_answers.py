"""Queries of a bundle: ranks, probabilities and calibration by hand, indicators, ablations, and names as typed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import isi
from isi.bundle import calibration
from isi.bundle.calibration import HeldOutCalibration, answer, fit_curve, fit_platt
from isi.bundle.folder import InsertionRecord
from isi.bundle.insert import InsertedEntity, NewEntity, ablations, before, insert_entity
from isi.bundle.query import OpenBundle, Query, find, open_bundle, queries_of
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from tests.small_bundle import (
    BETWEEN,
    NAMES,
    RELATIONS,
    VECTORS,
    WORDS,
    new_entity,
    opened,
    random_bundle,
    small,
    written,
)

KITCHEN, BEDROOM, KETTLE, BED, TURN_ON, LIE_ON = range(6)
AT, HAS = range(2)
FACTS = [("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")]


def stove(**changed: Any) -> NewEntity:
    given: dict[str, Any] = {"name": "stove", "kind": "object", "triples": FACTS, "vector": [0.6, 0.8, 0.0]}
    return new_entity(**{**given, **changed})


def again(inserted: InsertedEntity, record: InsertionRecord) -> InsertedEntity:
    return insert_entity(*before(inserted.opened, record))


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
    """With two scores the most probable logistic curve meets the mean target of each."""
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


@pytest.mark.parametrize("pieces", ["both", "words", "triples"])
@pytest.mark.parametrize("name", ["soft_hybrid", "soft_es", "soft_rs"])
def test_weights_are_those_of_the_initializer(name: str, pieces: str) -> None:
    changed = {"both": {}, "words": {"triples": []}, "triples": {"vector": None}}[pieces]
    given = opened()
    inserted = insert_entity(given, stove(initializer=name, **changed))
    assert inserted.result.weights is not None
    expected = torch.from_numpy(inserted.result.weights[0]) @ inserted.opened.embedding.entity[0, :-1]
    np.testing.assert_allclose(inserted.vector, expected.numpy(), rtol=1e-5, atol=1e-6)


def test_indicators_are_shown_with_how_similar_they_are() -> None:
    shown = insert_entity(opened(), stove(initializer="es", options={"k": 2})).indicators()
    assert {one.id: (one.weight, round(one.words or 0, 4)) for one in shown} == {
        BED: (0.5, 0.8),
        LIE_ON: (0.5, 0.64),
    }
    places = np.array(RELATIONS) * np.array(VECTORS)[[KITCHEN, TURN_ON]]  # where each fact puts it, as 1 / 1 = 1
    for one in shown:
        vector = np.array(VECTORS[one.id])
        cosines = places @ vector / np.linalg.norm(vector)
        assert one.relations == pytest.approx(cosines.mean())
    shown = insert_entity(opened(), stove(triples=[], initializer="es", options={"k": 1})).indicators()
    assert [(one.id, one.weight, one.relations) for one in shown] == [(BED, 1.0, None)]


def test_an_insertion_is_that_of_the_library_and_leaves_what_is_known() -> None:
    given = opened()
    inserted = insert_entity(given, stove())
    words = np.concatenate([np.array(WORDS, np.float32), [[0.6, 0.8, 0.0]]]).astype(np.float32)
    expected = isi.insert(
        given.entities, given.relations, FACTS, new=["stove"], model="distmult", entity_names=NAMES,
        relation_names=BETWEEN, known_triples=given.triples, words=words,
    )  # fmt: skip
    assert inserted.opened.entities.tobytes() == expected.entities.tobytes()
    assert inserted.opened.entities[:6].tobytes() == given.entities.tobytes()
    assert inserted.opened.triples.tolist()[-2:] == [[6, AT, KITCHEN], [6, HAS, TURN_ON]]
    assert inserted.record.initializer == "map_soft_hybrid"


def inserted_twice() -> InsertedEntity:
    """A stove, then a hob with a triple about the stove."""
    first = insert_entity(opened(), stove())
    triples = [("hob", "atLocation", "stove"), ("hob", "hasAffordance", "turn on")]
    return insert_entity(first.opened, stove(name="hob", triples=triples, vector=None))


def test_an_insertion_is_reproduced_whatever_came_after_it() -> None:
    inserted = inserted_twice()
    for name, record in inserted.opened.insertions().items():
        stored = inserted.opened.entities[inserted.opened.entity_ids[name]]
        assert again(inserted, record).vector.tobytes() == stored.tobytes()


def test_an_ablation_is_an_insertion_without_one_piece() -> None:
    inserted = inserted_twice()
    record = inserted.opened.insertions()["stove"]
    shown = again(inserted, record).indicators()
    queries = [Query(6, AT, TAIL)]
    result = list(ablations(inserted.opened, record, shown, queries, 1))
    assert [one.left_out for one in result] == ["fact", "fact", "words", *["indicator"] * len(shown)]
    own = inserted.opened.entities[6].astype(float)
    fewer = insert_entity(opened(), stove(triples=FACTS[1:])).vector.astype(float)
    assert result[0].cosine == pytest.approx(own @ fewer / math.sqrt((own @ own) * (fewer @ fewer)))
    assert result[0].moved == pytest.approx(np.linalg.norm(own - fewer) / np.linalg.norm(own))
    named = next(one for one in result if one.left_out == "indicator")
    row = NAMES.index(named.what)
    rest = [number for number in range(6) if number != row]
    triples = [triple for triple in small().triples.tolist() if row not in (triple[0], triple[2])]
    without = isi.insert(
        small().entities[rest], small().relations,
        [fact for fact in FACTS if named.what not in fact], new=["stove"], model="distmult",
        entity_names=[NAMES[number] for number in rest], relation_names=BETWEEN,
        known_triples=[(NAMES[h], BETWEEN[r], NAMES[t]) for h, r, t in triples],
        words=np.array([WORDS[number] for number in rest] + [[0.6, 0.8, 0.0]], np.float32),
    ).entities[-1].astype(float)  # fmt: skip
    assert named.moved == pytest.approx(np.linalg.norm(own - without) / np.linalg.norm(own))


def test_without_its_only_piece_nothing_is_inserted() -> None:
    inserted = insert_entity(opened(), stove(triples=[]))
    record = inserted.record
    (result,) = ablations(inserted.opened, record, [], [], 1)
    assert (result.left_out, result.initializer, result.cosine) == ("words", None, None)


# Names


@pytest.mark.parametrize("text", ["turn on", "Turn On", "turnOn", "turn_on", "turn-on", "turnon", "TURN ON"])
def test_names_are_found_without_regard_to_case_and_gaps(text: str) -> None:
    assert find(text, ["turn off", "turn on"], "ENTITY", "an entity") == "turn on"


def test_a_name_as_it_is_written_goes_first_and_none_is_guessed() -> None:
    names = ["Apple", "apple"]
    assert find("apple", names, "", "") == "apple"
    with pytest.raises(InputError, match=r"^ENTITY: .* got 'APPLE', written as 'Apple', 'apple'$"):
        find("APPLE", names, "ENTITY", "an entity")
    with pytest.raises(InputError, match=r"got 'aple' \(did you mean 'apple'\?\)$"):
        find("aple", ["apple", "pear"], "ENTITY", "an entity")
    with pytest.raises(InputError, match=r"got 'zz' \(there are 'apple', 'pear'\)$"):
        find("zz", ["apple", "pear"], "ENTITY", "an entity")


# What does not fit


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"model_name": "holographic"}, r"^one/embedding\.json: family: .*expected one of "),
        ({"model_name": "transe"}, r"^one/embedding\.json: family: .*margin"),
        (
            {"model_name": "rotate", "model_options": {"margin": 1.0, "squared": False}},
            r"^one/vectors\.\w+: .*rel.* 2",
        ),
    ],
)
def test_a_model_that_the_tables_are_not_of_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], line: str
) -> None:
    manifest = small().manifest.model_copy(update=change)
    monkeypatch.chdir(tmp_path)
    written(Path("one"), small(manifest=manifest))
    with pytest.raises(InputError, match=line):
        open_bundle(Path("one"))


#: Of the random bundle.
ENTITIES, LABELS = 30, 2


def model() -> OpenBundle:
    return opened(random_bundle(120))


def calibration_of(of: OpenBundle, **changed: Any) -> HeldOutCalibration:
    triples = [("new", "in", "e1"), ("e2", "on", "new")]
    return HeldOutCalibration(
        insert_entity(of, new_entity(**{"name": "new", "triples": triples, "vector": np.ones(4), **changed}))
    )


@pytest.mark.parametrize("changed", [{}, {"vector": None}, {"initializer": "rs", "options": {"k": 3}}])
def test_held_out_entities_are_inserted_as_the_new_one_was(changed: dict[str, Any]) -> None:
    known = model()
    result = calibration_of(known, **changed)
    assert len(result.held_out) == ENTITIES
    names, labels = known.entity_names, known.relation_names
    hidden = {one.entity for one in result.held_out[:3]}  # a tenth of them, together
    for one in result.held_out[:3]:
        assert len(one.insert_triples) == 2
        assert (one.insert_triples[:, [HEAD, TAIL]] == one.entity).sum() == 2
        assert np.isin(one.insert_triples[:, [HEAD, TAIL]], list(hidden)).sum() == 2
        facts = [(names[head], labels[relation], names[tail]) for head, relation, tail in one.insert_triples.tolist()]
        assert set(facts) <= set(known.named_triples())
        rest = known.part(np.array([row for row in range(ENTITIES) if row not in hidden]))
        words = None if "vector" in changed else known.words
        given = {"name": names[one.entity], "triples": facts, "vector": None if words is None else words[one.entity]}
        alone = insert_entity(
            rest, new_entity(**{"initializer": result.inserted.result.initializer, **changed, **given})
        )
        np.testing.assert_allclose(one.vector.numpy(), alone.vector, rtol=1e-4, atol=1e-5)


def test_a_curve_goes_through_answers_that_are_no_insert_triples() -> None:
    known = model()
    result = calibration_of(known)
    scores, right = [], []
    everyone = set(range(ENTITIES))
    for one in result.held_out:
        true = known.answers.get(Query(one.entity, 1, HEAD))
        if true:
            triples = {
                head for head, relation, tail in one.insert_triples.tolist() if (relation, tail) == (1, one.entity)
            }
            for other in sorted(everyone - {one.entity} - triples):
                vectors = (known.embedding.entity[0, other], known.embedding.relation[0, 1], one.vector)
                scores.append(float(known.model.score(*vectors)))
                right.append(other in true)
    expected = fit_platt(torch.tensor(scores).double(), torch.tensor(right))
    curve = result.curve(1, HEAD)
    assert curve is not None
    assert (curve.slope, curve.offset) == pytest.approx((expected.slope, expected.offset), rel=1e-3, abs=1e-4)


def test_held_out_calibration_serves_the_inserted_entity_alone() -> None:
    result = calibration_of(model())
    opened = result.inserted.opened
    for entity, curve in ((ENTITIES, result.curve(0, TAIL)), (3, fit_curve(opened, 0, TAIL))):
        (best,) = answer(opened, Query(entity, 0, TAIL), 1, result)
        assert curve is not None
        assert best.probability == pytest.approx(curve(torch.tensor([best.score])).item())


def test_with_too_few_right_answers_a_curve_is_shared_or_missing() -> None:
    known = model()
    few = replace(known, triples=np.concatenate([known.triples[known.triples[:, 1] == 0], [[3, 1, 4]]]))
    result = calibration_of(few)
    assert result.curve(1, TAIL) == result.curve(1, HEAD) is not None  # of all relations
    assert calibration_of(replace(known, triples=np.zeros((0, 3), np.int64))).curve(0, TAIL) is None


def test_the_curve_of_all_relations_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    result, drawn = calibration_of(model()), list[int]()
    monkeypatch.setattr(calibration, "LEAST_RIGHT", 60)  # more than those of one relation and slot
    monkeypatch.setattr(
        calibration, "fit_platt", lambda scores, right: drawn.append(len(scores)) or fit_platt(scores, right)
    )
    curves = {result.curve(relation, slot) for relation in range(LABELS) for slot in (HEAD, TAIL)}
    assert len(curves) == len(drawn) == 1


def test_where_no_entity_is_left_none_is_held_out() -> None:
    alone = replace(model().part(np.array([1])), triples=np.array([[0, 0, 0]]))
    result = calibration_of(alone, triples=[], vector=None, initializer="mean")
    assert result.held_out == []
    assert result.curve(0, TAIL) is None
