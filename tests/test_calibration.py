"""Held-out calibration: known entities are hidden, inserted as the new entity was, and queried."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from isi.bundle import calibration
from isi.bundle.answers import answer
from isi.bundle.calibration import HeldOutCalibration, fit_curve, fit_platt
from isi.bundle.insert_entity import NewEntity, insert_entity, without_entities
from isi.bundle.manifest import Bundle, Manifest
from isi.bundle.query import OpenBundle, Query, open_bundle
from isi.graph.graph import HEAD, TAIL
from tests.small_graphs import random_embedding, random_graph

ENTITIES, RELATIONS = 30, 2


def model(triples: int = 120) -> OpenBundle:
    """Of random vectors, with as many known triples."""
    graph, stack = random_graph(ENTITIES, RELATIONS, triples), random_embedding(1, ENTITIES, RELATIONS, 8)
    names = [f"e{number}" for number in range(ENTITIES)]
    manifest = Manifest(model_name="analogy", model_options={}, words=None, made={}, inserted=[])
    bundle = Bundle(
        manifest, stack.entity[0].numpy(), stack.relation[0].numpy(), names, [""] * ENTITIES, names, ["in", "on"],
        graph.triples.numpy(), np.random.default_rng(0).standard_normal((ENTITIES, 4)).astype(np.float32),
    )  # fmt: skip
    return open_bundle(bundle, Path("one"))


def news(**changed: Any) -> NewEntity:
    given: dict[str, Any] = {
        "name": "new", "phrase": "new", "kind": "", "insert_triples": [("new", "in", "e1"), ("e2", "on", "new")],
        "definition": None, "vector": np.ones(4, np.float32), "initializer": None, "options": {}, "seed": 0,
    }  # fmt: skip
    return NewEntity(**{**given, **changed})


def calibration_of(of: OpenBundle, **changed: Any) -> HeldOutCalibration:
    inserted = insert_entity(of, news(**changed))
    return HeldOutCalibration(inserted)


@pytest.mark.parametrize("changed", [{}, {"vector": None}, {"initializer": "rs", "options": {"k": 3}}])
def test_who_is_rehearsed_is_inserted_as_the_new_one_was(changed: dict[str, Any]) -> None:
    known = model()
    found = calibration_of(known, **changed)
    assert len(found.held_out) == ENTITIES
    names, labels = known.bundle.entity_names, known.bundle.relation_names
    hidden = {one.entity for one in found.held_out[:3]}  # a tenth of them, together
    for one in found.held_out[:3]:
        assert len(one.insert_triples) == 2
        assert not {other for *_, other in one.insert_triples} & hidden
        own = names[one.entity]
        facts = [
            (own, labels[relation], names[other]) if slot == TAIL else (names[other], labels[relation], own)
            for relation, slot, other in one.insert_triples
        ]
        for head, relation, tail in facts:
            assert (names.index(head), labels.index(relation), names.index(tail)) in set(
                map(tuple, known.bundle.triples.tolist())
            )
        rest = without_entities(known, np.array([row for row in range(ENTITIES) if row not in hidden]))
        words = None if "vector" in changed else known.bundle.words
        given = {
            **changed,
            "insert_triples": facts,
            "name": own,
            "vector": None if words is None else words[one.entity],
        }
        alone = insert_entity(rest, news(**{"initializer": found.inserted.result.initializer, **given}))
        np.testing.assert_allclose(one.vector.numpy(), alone.vector, rtol=1e-4, atol=1e-5)


def test_a_curve_goes_through_answers_that_were_not_told() -> None:
    known = model()
    found = calibration_of(known)
    scores, right = [], []
    everyone = set(range(ENTITIES))
    for one in found.held_out:
        true = known.answers.get((one.entity, 1, HEAD))
        if true:
            for other in sorted(
                everyone - {one.entity} - {end for r, slot, end in one.insert_triples if (r, slot) == (1, HEAD)}
            ):
                vectors = (known.embedding.entity[0, other], known.embedding.relation[0, 1], one.vector)
                scores.append(float(known.model.score(*vectors)))
                right.append(other in true)
    expected = fit_platt(torch.tensor(scores).double(), torch.tensor(right))
    curve = found.curve(1, HEAD)
    assert curve is not None
    assert (curve.slope, curve.offset) == pytest.approx((expected.slope, expected.offset), rel=1e-3, abs=1e-4)


def test_an_inserted_entity_is_asked_by_its_rehearsal_and_a_known_one_is_not() -> None:
    found = calibration_of(model())
    opened = found.inserted.opened
    for given, curve in ((ENTITIES, found.curve(0, TAIL)), (3, fit_curve(opened, 0, TAIL))):
        (best,) = answer(opened, Query(given, 0, TAIL), 1, found)
        assert curve is not None
        assert best.probability == pytest.approx(curve(torch.tensor([best.score])).item())


def test_what_too_few_answers_tell_is_shared_or_left_out() -> None:
    bundle = model().bundle
    few = Bundle(
        **{**vars(bundle), "triples": np.concatenate([bundle.triples[bundle.triples[:, 1] == 0], [[3, 1, 4]]])}
    )
    found = calibration_of(open_bundle(few, Path("one")))
    assert found.curve(1, TAIL) == found.curve(1, HEAD) is not None  # of all relations
    none = Bundle(**{**vars(bundle), "triples": np.zeros((0, 3), np.int64)})
    assert calibration_of(open_bundle(none, Path("one"))).curve(0, TAIL) is None


def test_the_curve_of_all_relations_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    found, drawn = calibration_of(model()), list[int]()
    monkeypatch.setattr(calibration, "LEAST_RIGHT", 60)  # more than those of one relation and slot
    monkeypatch.setattr(
        calibration, "fit_platt", lambda scores, right: drawn.append(len(scores)) or fit_platt(scores, right)
    )
    curves = {found.curve(relation, slot) for relation in range(RELATIONS) for slot in (HEAD, TAIL)}
    assert len(curves) == len(drawn) == 1


def test_where_nobody_is_left_nothing_is_rehearsed() -> None:
    alone = without_entities(model(), np.array([1]))
    alone = replace(alone, bundle=replace(alone.bundle, triples=np.array([[0, 0, 0]])))
    found = calibration_of(alone, insert_triples=[], vector=None, initializer="mean")
    assert found.held_out == []
    assert found.curve(0, TAIL) is None
