"""Insertions into a home: the same as by ``isi.insert``, and explained by a second insertion."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import isi
from isi.errors import InputError
from isi.home.bundle import Fact
from isi.home.choosing import HARM
from isi.home.home import Home
from isi.home.loaded import LoadedEmbedding
from tests.small_bundle import (
    KINDS,
    NAMES,
    RELATIONS,
    VECTORS,
    WORDS,
    opened,
    random_bundle,
    without_words,
    worded,
)

EXAMPLES = Path(__file__).parent.parent / "examples"
KITCHEN, BEDROOM, KETTLE, BED, TURN_ON, LIE_ON = range(6)
FACTS = [("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")]
WORD = [0.6, 0.8, 0.0]
HOB = ("hob", "atLocation", "kitchen")


@pytest.fixture
def home(tmp_path: Path) -> Home:
    """The small bundle, whose word vectors are of a file that has one of ``stove``."""
    return Home(worded(tmp_path, stove=WORD))


@pytest.fixture
def bare() -> Home:
    """A random bundle of 30 entities with 120 triples, without words or kinds."""
    return Home(replace(random_bundle(120), words=None))


def vector(home: Home, name: str = "stove") -> np.ndarray:
    return home.inserted[name].vector


def by_library(home: Home, facts: Any, new: Sequence[str], **options: Any) -> Any:
    """The insertion by ``isi.insert``."""
    base = home.base
    return isi.insert(
        base.entities,
        base.relations,
        facts,
        new=new,
        model=base.model,
        entity_names=base.entity_names,
        relation_names=base.relation_names,
        known_triples=base.triples,
        **options,
    )


# The vector


@pytest.mark.parametrize("facts", [FACTS, FACTS[:1], []], ids=len)
def test_an_insertion_is_that_of_the_library(home: Home, facts: list[Fact]) -> None:
    home.tell(facts, entities="stove")
    words = np.array([*WORDS, WORD], np.float32)
    expected = by_library(
        home,
        facts,
        ["stove"],
        words=words,
        kinds=[*home.base.kinds, "object"],
        trained_with="logistic",
    )
    assert vector(home).tobytes() == expected.entities[-1].tobytes()
    # by its facts, or the bed, which has the most similar word
    assert home.inserted["stove"].kind == "object"


def test_an_initializer_is_chosen_as_by_the_library_and_serves_entities_with_more_facts(
    bare: Home,
) -> None:
    chosen: dict[str, Any] = {}
    for number, name in ((1, "n1"), (2, "n2"), (2, "m2"), (3, "n3"), (4, "n4")):
        facts = [(name, "in", f"e{row}") for row in range(number)]
        bare.tell(facts, entities=name)
        row = bare.inserted[name]
        assert row.key == (min(number, 3), False, "")  # four are served by the choice for three
        about = chosen or {"harm": HARM}
        expected = by_library(bare, facts, [name], trained_with="logistic", **about)
        assert (row.initializer, row.options) == (expected.initializer, expected.details.options)
        assert row.vector.tobytes() == expected.entities[-1].tobytes()
        chosen = {"initializer": row.initializer, "options": row.options}
    stored = bare.database.rows("SELECT facts, words FROM choice ORDER BY facts")
    assert stored == [(1, 0), (2, 0), (3, 0)]


def test_probabilities_of_an_inserted_entity_are_those_of_the_library(bare: Home) -> None:
    facts = [("n", "in", "e1"), ("e2", "on", "n")]
    bare.tell(facts, entities="n", initializer="map")
    expected = by_library(bare, facts, ["n"], initializer="map")
    for query in (("n", "on", None), (None, "in", "n"), ("n", None, "e5")):
        answers = bare.ask(*query, top=30).answers
        triples = [[part or each.entity for part in query] for each in answers]
        probabilities = [each.probability for each in answers]
        assert probabilities == pytest.approx(expected.probability(triples).tolist())


def test_inserted_entities_are_no_indicators_and_those_that_share_facts_go_together(
    home: Home,
) -> None:
    about: dict[str, Any] = {"initializer": "rs", "options": {"k": 2}}
    home.tell([HOB], entities="hob", **about)
    home.tell({"oven": {"atLocation": "kitchen"}}, **about)
    assert vector(home, "oven").tobytes() == vector(home, "hob").tobytes()
    assert {each.entity for each in home.explain("oven").indicators} <= set(NAMES)
    facts, new = [*FACTS, ("tray", "atLocation", "stove")], ["stove", "tray"]
    home.tell(facts[:2], entities="stove", initializer="map")
    assert home.tell(facts[2:], entities="tray", initializer="map").updated == ["stove"]
    about = {"kinds": [*KINDS, "object", "object"], "initializer": "map"}
    about["words"] = np.array([*WORDS, WORD, [0.0] * 3], np.float32)
    expected = by_library(home, facts, new, **about).entities
    np.testing.assert_allclose([vector(home, name) for name in new], expected[-2:], atol=1e-6)


# Kinds and names


@pytest.fixture(scope="module")
def household() -> LoadedEmbedding:
    """The entities and triples of ``examples/home.csv``, with random vectors and without words."""
    triples = pd.read_csv(EXAMPLES / "home.csv", dtype=str).drop_duplicates()
    kinds = pd.read_csv(EXAMPLES / "home_kinds.csv", dtype=str).set_index("entity")["kind"]
    relations = sorted(set(triples["relation"]))
    ids = {name: row for row, name in enumerate(kinds.index)}
    ends = triples["head"].map(ids), triples["tail"].map(ids)
    rng = np.random.default_rng(0)
    return opened(
        entities=rng.normal(size=(len(ids), 8)).astype(np.float32),
        relations=rng.normal(size=(len(relations), 8)).astype(np.float32),
        entity_names=list(ids),
        kinds=kinds.tolist(),
        phrases=list(ids),
        relation_names=relations,
        triples=np.stack([ends[0], triples["relation"].map(relations.index), ends[1]], 1),
        words=None,
        manifest=without_words().manifest,
    )


NAMED_AFTER_ROOMS = {
    "kitchen scale": "kitchen",
    "kitchen towel": "kitchen",
    "bathroom scale": "bathroom",
    "toilet brush": "bathroom",
    "bedroom lamp": "bedroom",
    "shower gel": "bathroom",
    "living room rug": "living room",
}


@pytest.mark.parametrize("has_fact", [True, False])
@pytest.mark.parametrize("initializer", [None, "es"])
def test_what_is_named_after_a_room_is_an_object_like_other_objects(
    household: LoadedEmbedding, initializer: str | None, has_fact: bool
) -> None:
    home = Home(household)
    for name, room in NAMED_AFTER_ROOMS.items():
        facts = [(name, "atLocation", room)] * has_fact
        home.tell(facts, entities=name, initializer=initializer)
        like = {household.kinds[one.id] for one in home.explain(name).indicators}
        assert (home.inserted[name].kind, like) == ("object", {"object"}), name


@pytest.mark.parametrize("name", ["garage", "dining room", "bathroom cabinet", "workbench"])
def test_a_place_of_known_things_is_a_room_if_it_is_named_like_one(
    household: LoadedEmbedding, name: str
) -> None:
    home = Home(household)
    facts = [("mug", "atLocation", name), ("book", "atLocation", name)]
    home.tell(facts, entities=name, initializer="mean")
    is_room = name in ("garage", "dining room")
    assert home.inserted[name].kind == ("room" if is_room else "object")


# Explanations


@pytest.mark.parametrize("facts", [FACTS, []], ids=["facts", "no facts"])
@pytest.mark.parametrize("words", [True, False], ids=["words", "no words"])
@pytest.mark.parametrize("name", ["soft_hybrid", "soft_es", "soft_rs"])
def test_weights_are_those_of_the_initializer(
    tmp_path: Path, name: str, words: bool, facts: list[Fact]
) -> None:
    home = Home(worded(tmp_path, **{"stove": WORD} if words else {}))
    home.tell(facts, entities="stove", initializer=name)
    shown = {each.id: each.weight for each in home.explain("stove").indicators if each.weight}
    mixed = sum(weight * np.array(VECTORS[row]) for row, weight in shown.items())
    # the objects, if its kind is known
    assert shown.keys() <= {KETTLE, BED} or not (words or facts)
    np.testing.assert_allclose(vector(home), mixed, atol=0.05)  # without weights below a hundredth


def test_indicators_are_shown_with_how_similar_they_are(home: Home) -> None:
    home.tell(FACTS, entities="stove", initializer="es", options={"k": 2})
    shown = {one.entity: one for one in home.explain("stove").indicators}
    assert {name: one.weight for name, one in shown.items()} == {"bed": 0.5, "kettle": 0.5}
    cosines = {name: one.words for name, one in shown.items()}
    assert cosines == pytest.approx({"bed": 0.8, "kettle": 0.6})
    # where each fact puts it, as 1 / 1 = 1
    places = np.array(RELATIONS) * np.array(VECTORS)[[KITCHEN, TURN_ON]]
    for one in shown.values():
        known = np.array(VECTORS[one.id])
        assert one.relations == pytest.approx((places @ known / np.linalg.norm(known)).mean())
    home.remove(facts=FACTS)
    assert {one.relations for one in home.explain("stove").indicators} == {None}


def test_facts_and_words_are_listed(home: Home) -> None:
    home.tell(FACTS, entities="stove")
    explained = home.explain("stove")
    assert explained.facts == sorted(FACTS)
    assert explained.words.startswith("by ")


def test_interference_is_that_of_the_library(home: Home) -> None:
    assert home.interference() is None
    home.tell(FACTS, entities="stove", initializer="mean")
    alone = home.interference()
    home.tell([HOB], entities="hob", initializer="mean")
    assert home.interference("stove") == home.interference(["stove", "stove"]) == alone
    assert home.interference() != alone
    done = by_library(home, FACTS, ["stove"], initializer="mean", kinds=[*KINDS, "object"])
    expected = done.interference()
    assert alone
    assert (alone.h_old, alone.h_cur) == pytest.approx((expected.h_old, expected.h_cur))
    with pytest.raises(InputError, match="argument 'entities'"):
        home.interference([5])  # type: ignore[list-item]
