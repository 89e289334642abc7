"""``isi.from_pykeen``: a home of a PyKEEN model answers and inserts as the
model and ``isi.pykeen`` do.
"""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import isi
from isi.errors import InputError
from isi.home.answers import Answer
from tests.small_pykeen import ENTITIES, RELATIONS, model_of, ring

pytest.importorskip("pykeen")

from pykeen.pipeline import PipelineResult
from pykeen.predict import predict_target
from pykeen.triples import CoreTriplesFactory

pytestmark = pytest.mark.usefixtures("quick")
FACTS = [("cup", "r0", "e1"), ("cup", "r1", "e4"), ("e3", "r1", "cup")]
MODELS: list[tuple[str, dict[str, Any]]] = [
    ("distmult", {}),
    ("complex", {}),
    ("transe", {"scoring_fct_norm": 2}),
    ("rotate", {}),
    ("rescal", {}),
]


def rank_of(answer: Answer) -> int:
    return answer.rank


@pytest.mark.parametrize("inverse", [False, True], ids=["", "inverse"])
@pytest.mark.parametrize(("name", "options"), MODELS, ids=[name for name, _ in MODELS])
def test_vectors_and_answers_are_those_of_the_model(
    name: str, options: dict[str, Any], inverse: bool
) -> None:
    known = ring(inverse)
    model = model_of(name, known, **options)
    before = deepcopy(model.state_dict())
    home = isi.from_pykeen(model, known, margin=0.0)
    assert len(home.base.triples) == len(set(map(tuple, known.mapped_triples.tolist())))
    for side, query in (("tail", ("e2", "r1", None)), ("head", (None, "r1", "e2"))):
        given = {"head": query[0], "tail": query[2]}
        target = predict_target(model, relation="r1", triples_factory=known, **given).df
        expected = dict(zip(target[f"{side}_label"], target["score"], strict=True))
        answers = home.ask(*query, top=ENTITIES).answers
        listed = {each.entity: each.score for each in answers}
        assert listed.keys() | {"e2"} == expected.keys()
        assert listed == pytest.approx({label: expected[label] for label in listed}, abs=1e-4)
        by_rank = sorted(answers, key=rank_of)
        assert [each.score for each in by_rank] == sorted(listed.values(), reverse=True)
    initializer = "map"
    home.tell(FACTS, entities="cup", initializer=initializer)
    how = {"new": ["cup"], "initializer": initializer, "margin": 0.0}
    done = isi.pykeen.insert(model, known, FACTS, **how).rows
    np.testing.assert_allclose(home.inserted["cup"].vector, done.entities[-1], atol=1e-6)
    assert home.now.entities[:ENTITIES].tobytes() == home.base.entities.tobytes()
    np.testing.assert_allclose(home.now.entities[:ENTITIES], done.entities[:ENTITIES], rtol=1e-6)
    assert home.ask("cup", "r0").answers[0].entity == "e1"
    assert all(torch.equal(before[key], value) for key, value in model.state_dict().items())


@pytest.mark.parametrize(("name", "options"), MODELS[:-1], ids=[name for name, _ in MODELS[:-1]])
def test_what_is_saved_answers_as_before(
    tmp_path: Path, name: str, options: dict[str, Any]
) -> None:
    known = ring()
    kinds = {f"e{row}": ("place" if row % 2 else "object") for row in range(ENTITIES)}
    home = isi.from_pykeen(model_of(name, known, **options), known, kinds=kinds)
    home.tell(FACTS, entities="cup")
    home.save(tmp_path / "home")
    with isi.open(tmp_path / "home") as again:
        for query in (("cup", "r0", None), ("e3", None, "e4")):
            assert again.ask(*query, top=99) == home.ask(*query, top=99)
        assert again.base.kinds == [kinds[label] for label in home.base.entity_names]


@pytest.mark.parametrize(
    ("name", "inverse"), [("rescal", False), ("distmult", True), ("transe", True)]
)
def test_a_model_that_a_folder_cannot_hold_is_not_saved(
    tmp_path: Path, name: str, inverse: bool
) -> None:
    known = ring(inverse)
    home = isi.from_pykeen(model_of(name, known), known)
    with pytest.raises(InputError, match=r"^save"):
        home.save(tmp_path / "home")
    assert not (tmp_path / "home").exists()


def test_the_result_of_a_pipeline_serves_and_ids_without_labels_do_not() -> None:
    known = ring()
    model = model_of("distmult", known)
    result = object.__new__(PipelineResult)
    result.model, result.training = model, known
    assert isi.from_pykeen(result).ask("e2", "r1") == isi.from_pykeen(model, known).ask("e2", "r1")
    with pytest.raises(InputError, match="'factory'"):
        isi.from_pykeen(model, CoreTriplesFactory(known.mapped_triples, ENTITIES, RELATIONS))
    with pytest.raises(InputError, match="'factory'"):
        isi.from_pykeen(model)


def test_a_model_without_inverse_explains_without_relational_scores() -> None:
    known = ring()
    home = isi.from_pykeen(model_of("tucker", known), known)
    home.tell(FACTS, entities="cup")
    indicators = home.explain("cup").indicators
    assert indicators
    assert {each.relations for each in indicators} == {None}
    assert home.explain("cup").entity == "cup"


@pytest.mark.parametrize("inverse", [False, True], ids=["", "inverse"])
@pytest.mark.parametrize("name", ["transe", "complex", "rescal"])
def test_a_model_of_pykeen_comes_back_after_any_change(name: str, inverse: bool) -> None:
    known = ring(inverse)
    model = model_of(name, known)
    home = isi.from_pykeen(model, known)
    trained = {tuple(fact) for fact in known.triples}
    of_mug = {("mug", "r2", "cup"), ("mug", "r2", "e5")}
    every, retracted = trained | {*FACTS} | of_mug, min(trained)
    changes: list[tuple[str, tuple[Any, ...], set[Any], list[str]]] = [
        ("tell", ([],), trained, []),
        ("tell", (FACTS,), trained | {*FACTS}, ["cup"]),
        ("tell", ({"mug": {"r2": ["cup", "e5"]}},), every, ["cup", "mug"]),
        ("remove", ("cup",), trained | {("mug", "r2", "e5")}, ["mug"]),
        ("undo", (), every, ["cup", "mug"]),
        ("remove", ((), [retracted]), every - {retracted}, ["cup", "mug"]),
        ("tell", ([retracted],), every, ["cup", "mug"]),
    ]
    for verb, given, facts, entities in changes:
        getattr(home, verb)(*given)
        assert home.model is home.model
        assert {tuple(fact) for fact in home.factory.triples} == facts  # type: ignore[attr-defined]
        assert home.factory.create_inverse_triples == inverse
        labels = home.factory.entity_to_id  # type: ignore[attr-defined]
        assert [name for name in labels if labels[name] >= ENTITIES] == entities
        rows = isi.pykeen.read_model(home.model, home.factory.mapped_triples, 0.0).entity[0]
        np.testing.assert_allclose(rows, home.now.entities, rtol=1e-5, atol=1e-6)
    again, more = isi.pykeen.insert(home.model, home.factory, [("pan", "r0", "mug")])
    assert (again.num_entities, more.num_entities) == (ENTITIES + 3, ENTITIES + 3)
    assert model.num_entities == ENTITIES


@pytest.mark.parametrize(
    ("name", "inverse"), [("distmult", False), ("transe", True), ("rescal", False)]
)
def test_a_model_of_pykeen_has_no_new_relations(name: str, inverse: bool) -> None:
    known = ring(inverse)
    home = isi.from_pykeen(model_of(name, known), known)
    home.tell([("e1", "near", "e2"), ("e3", "near", "e4")])
    assert home.ask("e1", "near").answers[0].entity == "e2"
    assert home.factory.num_triples == known.num_triples
    assert home.model.num_relations == home.factory.num_relations
