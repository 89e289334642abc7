"""Held-out calibration: known entities are hidden, inserted as the new entity was, and queried."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from isi.bundle import calibration
from isi.bundle.calibration import HeldOutCalibration, answer, fit_curve, fit_platt
from isi.bundle.insert import insert_entity
from isi.bundle.query import OpenBundle, Query
from isi.graph.graph import HEAD, TAIL
from tests.small_bundle import new_entity, opened, random_bundle

ENTITIES, RELATIONS = 30, 2


def model() -> OpenBundle:
    return opened(random_bundle(120))


def calibration_of(of: OpenBundle, **changed: Any) -> HeldOutCalibration:
    told = [("new", "in", "e1"), ("e2", "on", "new")]
    return HeldOutCalibration(
        insert_entity(of, new_entity(**{"name": "new", "triples": told, "vector": np.ones(4), **changed}))
    )


@pytest.mark.parametrize("changed", [{}, {"vector": None}, {"initializer": "rs", "options": {"k": 3}}])
def test_held_out_entities_are_inserted_as_the_new_one_was(changed: dict[str, Any]) -> None:
    known = model()
    found = calibration_of(known, **changed)
    assert len(found.held_out) == ENTITIES
    names, labels = known.entity_names, known.relation_names
    hidden = {one.entity for one in found.held_out[:3]}  # a tenth of them, together
    for one in found.held_out[:3]:
        assert len(one.insert_triples) == 2
        assert (one.insert_triples[:, [HEAD, TAIL]] == one.entity).sum() == 2
        assert np.isin(one.insert_triples[:, [HEAD, TAIL]], list(hidden)).sum() == 2
        facts = [(names[head], labels[relation], names[tail]) for head, relation, tail in one.insert_triples.tolist()]
        assert set(facts) <= set(known.named_triples())
        rest = known.part(np.array([row for row in range(ENTITIES) if row not in hidden]))
        words = None if "vector" in changed else known.words
        given = {"name": names[one.entity], "triples": facts, "vector": None if words is None else words[one.entity]}
        alone = insert_entity(
            rest, new_entity(**{"initializer": found.inserted.result.initializer, **changed, **given})
        )
        np.testing.assert_allclose(one.vector.numpy(), alone.vector, rtol=1e-4, atol=1e-5)


def test_a_curve_goes_through_answers_that_are_no_insert_triples() -> None:
    known = model()
    found = calibration_of(known)
    scores, right = [], []
    everyone = set(range(ENTITIES))
    for one in found.held_out:
        true = known.answers.get(Query(one.entity, 1, HEAD))
        if true:
            told = {head for head, relation, tail in one.insert_triples.tolist() if (relation, tail) == (1, one.entity)}
            for other in sorted(everyone - {one.entity} - told):
                vectors = (known.embedding.entity[0, other], known.embedding.relation[0, 1], one.vector)
                scores.append(float(known.model.score(*vectors)))
                right.append(other in true)
    expected = fit_platt(torch.tensor(scores).double(), torch.tensor(right))
    curve = found.curve(1, HEAD)
    assert curve is not None
    assert (curve.slope, curve.offset) == pytest.approx((expected.slope, expected.offset), rel=1e-3, abs=1e-4)


def test_held_out_calibration_serves_the_inserted_entity_alone() -> None:
    found = calibration_of(model())
    opened = found.inserted.opened
    for given, curve in ((ENTITIES, found.curve(0, TAIL)), (3, fit_curve(opened, 0, TAIL))):
        (best,) = answer(opened, Query(given, 0, TAIL), 1, found)
        assert curve is not None
        assert best.probability == pytest.approx(curve(torch.tensor([best.score])).item())


def test_with_too_few_right_answers_a_curve_is_shared_or_missing() -> None:
    known = model()
    few = replace(known, triples=np.concatenate([known.triples[known.triples[:, 1] == 0], [[3, 1, 4]]]))
    found = calibration_of(few)
    assert found.curve(1, TAIL) == found.curve(1, HEAD) is not None  # of all relations
    assert calibration_of(replace(known, triples=np.zeros((0, 3), np.int64))).curve(0, TAIL) is None


def test_the_curve_of_all_relations_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    found, drawn = calibration_of(model()), list[int]()
    monkeypatch.setattr(calibration, "LEAST_RIGHT", 60)  # more than those of one relation and slot
    monkeypatch.setattr(
        calibration, "fit_platt", lambda scores, right: drawn.append(len(scores)) or fit_platt(scores, right)
    )
    curves = {found.curve(relation, slot) for relation in range(RELATIONS) for slot in (HEAD, TAIL)}
    assert len(curves) == len(drawn) == 1


def test_where_no_entity_is_left_none_is_held_out() -> None:
    alone = replace(model().part(np.array([1])), triples=np.array([[0, 0, 0]]))
    found = calibration_of(alone, triples=[], vector=None, initializer="mean")
    assert found.held_out == []
    assert found.curve(0, TAIL) is None
