"""Insertions into a bundle: the same as by ``isi.insert``, from facts in any order,
explained by a second insertion.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from isi.live.folder import WordSource, read
from isi.live.journal import Effect

import isi
from isi.errors import InputError
from isi.live.embedding import LiveEmbedding
from isi.live.groups import TOLERANCE
from isi.live.loaded import LoadedEmbedding
from tests.small_bundle import (
    BETWEEN,
    KINDS,
    NAMES,
    RELATIONS,
    VECTORS,
    WORDS,
    files,
    opened,
    random_bundle,
    small,
    without_words,
    worded,
    written,
)

EXAMPLES = Path(__file__).parent.parent / "examples"
KITCHEN, BEDROOM, KETTLE, BED, TURN_ON, LIE_ON = range(6)
FACTS = [("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")]
WORD = [0.6, 0.8, 0.0]
HOB = ("hob", "atLocation", "kitchen")
Fact = tuple[str, str, str]


@pytest.fixture
def home(tmp_path: Path) -> LiveEmbedding:
    """The small bundle, whose word vectors are of a file that has one of ``stove``."""
    return LiveEmbedding(worded(tmp_path, stove=WORD))


@pytest.fixture
def bare() -> LiveEmbedding:
    """A random bundle of 30 entities with 120 triples, without words or kinds."""
    return LiveEmbedding(replace(random_bundle(120), words=None))


def vector(live: LiveEmbedding, name: str = "stove") -> np.ndarray:
    return live.inserted[name].vector


def by_library(
    facts: Sequence[Fact], rows: Sequence[int] = range(6), word: Any = WORD, **options: Any
) -> np.ndarray:
    """The vector of a stove by ``isi.insert`` beside some of the known entities."""
    names = [NAMES[row] for row in rows]
    known = [fact for fact in small().named_triples() if {fact[0], fact[2]} <= set(names)]
    words = None if word is None else np.array([*(WORDS[row] for row in rows), word], np.float32)
    return isi.insert(
        small().entities[list(rows)],
        small().relations,
        [fact for fact in facts if {fact[0], fact[2]} & set(names)],
        new=["stove"],
        model="distmult",
        entity_names=names,
        relation_names=BETWEEN,
        known_triples=known,
        words=words,
        kinds=[*(KINDS[row] for row in rows), "object"],
        **options,
    ).entities[-1]


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """The distance of two vectors, divided by the length of the first."""
    return float(np.linalg.norm(one - other) / np.linalg.norm(one))


# The vector


@pytest.mark.parametrize("facts", [FACTS, FACTS[:1], []], ids=len)
def test_an_insertion_is_that_of_the_library_and_leaves_what_is_known(
    home: LiveEmbedding, facts: list[Fact]
) -> None:
    effect = home.insert("stove", facts)
    assert (effect.inserted, effect.updated, effect.removed, effect.known) == (["stove"], [], [], 0)
    assert vector(home).tobytes() == by_library(facts).tobytes()
    assert home.now.entities[:6].tobytes() == small().entities.tobytes()
    assert home.now.named_triples() == [*small().named_triples(), *facts]
    # by its facts, or the bed, which has the most similar word
    assert home.now.kinds[6] == "object"
    assert home.inserted["stove"].words.vector.tolist() == np.float32(WORD).tolist()  # type: ignore[union-attr]


def test_facts_are_given_in_any_form_and_a_kind_that_is_given_counts(home: LiveEmbedding) -> None:
    home.insert(
        "stove",
        {"atLocation": "kitchen", "hasAffordance": ["turn on"]},
        kind="room",
        initializer="mean",
    )
    row = home.inserted["stove"]
    assert (row.kind, row.record.insert_triples, row.record.initializer) == ("room", FACTS, "mean")
    assert row.vector == pytest.approx(np.mean(VECTORS[:2], axis=0))  # of the rooms


def test_an_initializer_is_chosen_once_for_each_number_of_facts_as_by_the_library(
    bare: LiveEmbedding,
) -> None:
    known = bare.base
    for number, name in ((2, "n2"), (2, "m2"), (3, "n3"), (4, "n4")):
        facts = [(name, "in", f"e{row}") for row in range(number)]
        bare.insert(name, facts)
        record = bare.inserted[name].record
        if number < 4:  # four facts are served by the choice for three
            expected = isi.insert(
                known.entities,
                known.relations,
                facts,
                new=[name],
                model="analogy",
                entity_names=known.entity_names,
                relation_names=known.relation_names,
                known_triples=known.triples,
                loss="logistic",
                tolerance=TOLERANCE,
            )
            assert (record.initializer, record.options, record.why) == (
                expected.initializer,
                expected.options,
                expected.why,
            )
            assert vector(bare, name).tobytes() == expected.entities[-1].tobytes()
    assert [(each.facts, each.words) for each in bare.groups.selected.values()] == [
        (2, False),
        (3, False),
    ]


def test_probabilities_of_an_inserted_entity_are_those_of_the_library(bare: LiveEmbedding) -> None:
    facts, known = [("n", "in", "e1"), ("e2", "on", "n")], bare.base
    bare.insert("n", facts, initializer="map")
    expected = isi.insert(
        known.entities,
        known.relations,
        facts,
        new=["n"],
        model="analogy",
        entity_names=known.entity_names,
        relation_names=known.relation_names,
        known_triples=known.triples,
        initializer="map",
    )
    tails, heads, between = (
        bare.ask("n", "on", top=30),
        bare.ask(None, "in", "n"),
        bare.ask("n", None, "e5"),
    )
    for triples, answers in (
        ([("n", "on", each.entity) for each in tails.answers], tails),
        ([(each.entity, "in", "n") for each in heads.answers], heads),
        ([("n", each.entity, "e5") for each in between.answers], between),
    ):
        assert [each.probability for each in answers.answers] == pytest.approx(
            expected.probability(triples).tolist()
        )
    first = bare.ask("n", "in").answers[0]
    assert (first.entity, first.given, first.known) == ("e1", True, True)


def test_inserted_entities_are_marked_and_are_no_indicators(home: LiveEmbedding) -> None:
    home.insert("hob", [HOB], initializer="rs", options={"k": 2})
    alone = vector(home, "hob")
    home.insert("stove", FACTS)
    home.insert("oven", [("oven", "atLocation", "kitchen")], initializer="rs", options={"k": 2})
    assert vector(home, "oven").tobytes() == alone.tobytes() == vector(home, "hob").tobytes()
    assert {each.entity for each in home.explain("oven").indicators} <= set(NAMES)
    inserted = {
        each.entity for each in home.ask(None, "atLocation", "kitchen").answers if each.inserted
    }
    assert inserted == {"hob", "stove", "oven"}


NAMED_AFTER_ROOMS = [
    ("kitchen scale", "kitchen"),
    ("kitchen towel", "kitchen"),
    ("kitchen timer", "kitchen"),
    ("bathroom scale", "bathroom"),
    ("toilet brush", "bathroom"),
    ("bath mat", "bathroom"),
    ("bedroom lamp", "bedroom"),
    ("shower gel", "bathroom"),
    ("kitchen knife block", "kitchen"),
    ("living room rug", "living room"),
]


@pytest.fixture(scope="module")
def household() -> LoadedEmbedding:
    """The entities and triples of ``examples/home.csv``, with random vectors and without words."""
    triples = pd.read_csv(EXAMPLES / "home.csv", dtype=str).drop_duplicates()
    kinds = pd.read_csv(EXAMPLES / "home_kinds.csv", dtype=str).set_index("entity")["kind"]
    relations = sorted(set(triples["relation"]))
    ids = {name: row for row, name in enumerate(kinds.index)}
    columns = (
        triples["head"].map(ids),
        triples["relation"].map(relations.index),
        triples["tail"].map(ids),
    )
    rng = np.random.default_rng(0)
    vectors, maps = (
        rng.normal(size=(number, 8)).astype(np.float32) for number in (len(ids), len(relations))
    )
    return opened(
        entities=vectors,
        relations=maps,
        entity_names=list(ids),
        kinds=kinds.tolist(),
        phrases=list(ids),
        relation_names=relations,
        triples=np.stack(columns, 1),
        words=None,
        manifest=without_words().manifest.model_copy(update={"words": None}),
    )


@pytest.mark.parametrize("told", [True, False], ids=["a fact", "no facts"])
@pytest.mark.parametrize("initializer", [None, "es", "mean"])
def test_what_is_named_after_a_room_is_an_object_like_other_objects(
    household: LoadedEmbedding, initializer: str | None, told: bool
) -> None:
    live, objects = LiveEmbedding(household), {"object"}
    for name, room in NAMED_AFTER_ROOMS:
        live.insert(name, {"atLocation": room} if told else {}, initializer=initializer)
        like = {household.kinds[one.id] for one in live.explain(name, top=1).indicators}
        assert (live.inserted[name].kind, like) == ("object", objects), name


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("garage", "room"),
        ("dining room", "room"),
        ("hallway", "room"),
        ("bathroom cabinet", "object"),
        ("plate rack", "object"),
        ("workbench", "object"),
    ],
)
def test_a_place_of_known_things_is_a_room_if_it_is_named_like_one(
    household: LoadedEmbedding, name: str, kind: str
) -> None:
    live = LiveEmbedding(household)
    live.insert(name, [("mug", "atLocation", name), ("book", "atLocation", name)])
    assert live.inserted[name].kind == kind


# Changes


def test_a_vector_follows_from_all_facts_in_whatever_order_they_came_and_changes_are_undone(
    tmp_path: Path,
) -> None:
    live, at_once = (LiveEmbedding(worded(tmp_path, stove=WORD)) for _ in range(2))
    live.insert("stove", FACTS[1:])
    first = vector(live)
    effect = live.observe([*FACTS[::-1], ("kettle", "atLocation", "kitchen")])
    assert (effect.updated, effect.known) == (["stove"], 2)
    at_once.insert("stove", FACTS)
    assert vector(live).tobytes() == vector(at_once).tobytes() != first.tobytes()
    assert live.ask("stove", "atLocation") == at_once.ask("stove", "atLocation")
    assert live.remove(facts=FACTS[:1]).updated == ["stove"]
    assert vector(live).tobytes() == first.tobytes()
    live.undo()
    assert vector(live).tobytes() == vector(at_once).tobytes()
    assert (live.undo().updated, live.undo().removed) == (["stove"], ["stove"])
    with pytest.raises(InputError):
        live.undo()
    assert [change.do for change in live.history] == [
        "insert",
        "observe",
        "remove",
        "undo",
        "undo",
        "undo",
    ]
    assert at_once.remove("stove").removed == ["stove"]
    assert at_once.now.named_triples() == live.now.named_triples() == small().named_triples()


@pytest.mark.parametrize("other", [" gas hob", "gas\u200b hob", "gas\u00a0hob", "gas hob"])
def test_forms_of_a_name_in_one_observation_are_one_entity(home: LiveEmbedding, other: str) -> None:
    facts = [("gas hob", "atLocation", "kitchen"), (other, "hasAffordance", "turn on")]
    effect = home.observe(facts, upsert=True)
    assert (effect.inserted, effect.facts) == (["gas hob"], 2)
    assert home.ask("gas hob", "hasAffordance").answers[0].given


def test_facts_between_known_entities_are_observed_and_removed(home: LiveEmbedding) -> None:
    fact = ("kettle", "atLocation", "bedroom")
    assert home.observe([fact, fact]) == Effect(facts=1)
    assert [(each.entity, each.given) for each in home.ask(*fact[:2]).answers] == [
        ("bedroom", True),
        ("kitchen", False),
    ]
    assert home.observe([fact]) == Effect(known=1)
    assert home.remove(facts=[fact]) == Effect(lost=[fact])
    assert home.now.named_triples() == small().named_triples()
    changes = len(home.history)
    assert home.remove() == Effect()
    assert len(home.history) == changes  # nothing to undo


def test_entities_that_share_a_fact_are_inserted_together_as_by_the_library(
    home: LiveEmbedding, tmp_path: Path
) -> None:
    facts = [
        ("qx", "atLocation", "kitchen"),
        ("qx", "hasAffordance", "turn on"),
        ("qz", "atLocation", "qx"),
    ]
    home.insert("qx", facts[:2], initializer="map")
    alone = vector(home, "qx")
    assert home.insert("qz", facts[2:], initializer="map").updated == ["qx"]
    expected = isi.insert(
        small().entities,
        small().relations,
        facts,
        new=["qx", "qz"],
        model="distmult",
        entity_names=NAMES,
        relation_names=BETWEEN,
        known_triples=small().named_triples(),
        kinds=[*KINDS, "object", "object"],
        initializer="map",
    ).entities
    np.testing.assert_allclose(home.now.entities, expected, atol=1e-6)
    # without a journal: by records of insertions
    opened = LiveEmbedding(read(written(tmp_path / "home", home.now)))
    assert opened.now.entities.tobytes() == home.now.entities.tobytes()
    assert [list(change.entities) for change in opened.history] == [["qx"], ["qz"]]
    opened.observe([("kettle", "atLocation", "bedroom")])
    opened.undo()
    assert opened.now.kinds == home.now.kinds
    opened.undo()
    np.testing.assert_allclose(vector(opened, "qx"), alone, atol=1e-6)


@pytest.mark.parametrize(
    "name", ["Kettle", "kettles", "KETTLES", "BedRoom", "turnOn", "copper kettle"]
)
def test_a_name_that_looks_like_a_known_one_is_refused_unless_it_is_new(
    tmp_path: Path, name: str
) -> None:
    live = LiveEmbedding(worded(tmp_path, **{"copper kettle": [0.95, 0.1, 0.1]}))
    facts = {"atLocation": "kitchen"}
    with pytest.raises(InputError, match=r"kettle|bedroom|turn on"):
        live.insert(name, facts)
    assert not live.history
    with pytest.raises(InputError, match=r"did you mean|is known"):
        live.observe([("kettle", "atLocation", name)], upsert=name == "kettles")
    assert live.insert(name, facts, new=True).inserted == [name]


@pytest.mark.parametrize(
    ("known", "new"),
    [
        ("10", "-10"),
        ("5", "+5"),
        ("2021-11-2", "2021-1-12"),
        ("chair_1_12", "chair_11_2"),
        ("a1", "a-1"),
        ("a 1", "a-1"),
        ("x1", "x 1"),
    ],
)
def test_names_that_differ_in_signs_or_between_digits_are_two_entities(
    known: str, new: str
) -> None:
    live = LiveEmbedding(opened(entity_names=[*NAMES[:-1], known]))
    facts = [(new, "atLocation", "kitchen")]
    with pytest.raises(InputError, match="did you mean"):
        live.observe(facts)
    assert live.observe(facts, upsert=True).inserted == [new]
    assert live.history[-1].facts == facts
    assert live.ask(new, "atLocation").query[0] == new
    assert live.remove(new).removed == [new]
    both = [*facts, (f"{new}0", "atLocation", "kitchen")]
    assert live.insert([new, f"{new}0"], both).inserted == [new, f"{new}0"]


@pytest.mark.parametrize("top", [-1, 0, 1.5, True, "2", None])
def test_a_number_of_answers_below_one_is_refused_by_name(home: LiveEmbedding, top: Any) -> None:
    with pytest.raises(InputError, match="'top'"):
        home.ask("kettle", "atLocation", top=top)
    with pytest.raises(InputError, match="'number'"):
        home.nearest("kettle", top)
    assert len(home.nearest("kettle", int(np.int64(2)))) == len(home.nearest("kettle", np.int64(2)))  # type: ignore[arg-type]


def test_tails_by_relation_are_facts_of_one_entity(home: LiveEmbedding) -> None:
    for names in (["qx", "qz"], []):
        with pytest.raises(InputError, match="'facts'"):
            home.insert(names, {"atLocation": "kitchen"})
    assert home.insert(["qx"], {"atLocation": "kitchen"}).facts == 1
    each = {"qz": {"atLocation": "kitchen"}, "qy": {"atLocation": "bedroom"}}
    assert home.insert(["qz", "qy"], each).facts == 2


def test_units_that_differ_in_case_are_two_entities_where_that_is_meant() -> None:
    live = LiveEmbedding(opened(entity_names=[*NAMES[:-1], "mW"]))
    facts = [(name, "atLocation", "kitchen") for name in ("MW", "Co", "CO")]
    with pytest.raises(InputError, match="'mW' is known"):
        live.insert("MW", {"atLocation": "kitchen"})
    with pytest.raises(InputError, match="'Co'"):
        live.insert(["Co", "CO"], facts)
    with pytest.warns(UserWarning, match="'MW' is not known.*'mW'"):
        assert live.ask("MW", "hasAffordance").query[0] == "mW"
    live.insert(["MW", "Co", "CO"], facts, new=True)
    assert [live.ask(name, "atLocation").query[0] for name in ("MW", "mW", "CO")] == [
        "MW",
        "mW",
        "CO",
    ]
    with pytest.raises(InputError, match="did you mean 'mW' or 'MW'"):
        live.ask("mw", "atLocation")  # one of two is not chosen


@pytest.mark.parametrize(
    ("name", "same"),
    [
        ("tv", "television"),
        ("fridge", "refrigerator"),
        ("kitchen towel", None),
        ("bath towel", None),
        ("night lamp", None),
        ("espresso machine", None),
        ("bread knife", None),
    ],
)
def test_names_of_one_thing_agree_in_all_words_and_not_in_the_head_noun_alone(
    name: str, same: str | None
) -> None:
    known = ["television", "refrigerator", "towel", "floor lamp", "coffee machine", "butter knife"]
    live = LiveEmbedding(small(entity_names=known, phrases=known, kinds=["object"] * 6, words=None))
    if same is None:
        live.insert(name)
    else:
        with pytest.raises(InputError, match=same):
            live.insert(name)


# Explanations


@pytest.mark.parametrize("facts", [FACTS, []], ids=["facts", "no facts"])
@pytest.mark.parametrize("words", [True, False], ids=["words", "no words"])
@pytest.mark.parametrize("name", ["soft_hybrid", "soft_es", "soft_rs"])
def test_weights_are_those_of_the_initializer(
    tmp_path: Path, name: str, words: bool, facts: list[Fact]
) -> None:
    live = LiveEmbedding(worded(tmp_path, **{"stove": WORD} if words else {}))
    live.insert("stove", facts, initializer=name)
    shown = {
        each.id: each.weight for each in live.explain("stove").indicators if each.weight is not None
    }
    mixed = sum(weight * np.array(VECTORS[row]) for row, weight in shown.items())
    # the objects, if its kind is known
    assert shown.keys() <= {KETTLE, BED} or not (words or facts)
    np.testing.assert_allclose(vector(live), mixed, atol=0.05)  # without weights below a hundredth


def test_indicators_are_shown_with_how_similar_they_are(home: LiveEmbedding) -> None:
    home.insert("stove", FACTS, initializer="es", options={"k": 2})
    shown = home.explain("stove").indicators
    assert {one.id: (one.weight, round(one.words or 0, 4)) for one in shown} == {
        BED: (0.5, 0.8),
        KETTLE: (0.5, 0.6),
    }
    # where each fact puts it, as 1 / 1 = 1
    places = np.array(RELATIONS) * np.array(VECTORS)[[KITCHEN, TURN_ON]]
    for one in shown:
        known = np.array(VECTORS[one.id])
        assert one.relations == pytest.approx((places @ known / np.linalg.norm(known)).mean())
    home.remove(facts=FACTS)
    assert [(one.id, one.relations) for one in home.explain("stove").indicators] == [
        (BED, None),
        (KETTLE, None),
    ]


def test_an_ablation_is_an_insertion_without_one_piece(home: LiveEmbedding) -> None:
    home.insert("stove", FACTS)
    home.insert("hob", [HOB])
    own, record = vector(home).astype(float), home.inserted["stove"].record
    explained = home.explain("stove", top=1)
    moved = {(one.left_out, one.what): one.moved for one in explained.without}
    cosine = {(one.left_out, one.what): one.cosine for one in explained.without}
    named: dict[str, Any] = {"initializer": record.initializer, "options": record.options}
    expected = {
        ("fact", " ".join(fact)): by_library([other for other in FACTS if other != fact], **named)
        for fact in FACTS
    }
    expected["words", "stove"] = by_library(FACTS, word=None, **named)
    for one in explained.indicators:
        rest = [row for row in range(6) if row != one.id]
        facts = [fact for fact in FACTS if one.entity not in fact]
        expected["indicator", one.entity] = by_library(facts, rest, **named)
    assert moved.keys() == expected.keys()
    assert list(moved.values()) == sorted(moved.values(), reverse=True)  # type: ignore[type-var]
    for piece, other in expected.items():
        assert moved[piece] == pytest.approx(distance(own, other), rel=1e-4)
        assert cosine[piece] == pytest.approx(
            own @ other / np.linalg.norm(own) / np.linalg.norm(other), rel=1e-4
        )


def test_an_ablation_lists_the_answers_that_it_changes(tmp_path: Path) -> None:
    """Without the bed, no known triple has ``lie on``: the kettle is the next one by its words."""
    live = LiveEmbedding(worded(tmp_path, stove=WORD))
    live.insert("stove", FACTS, initializer="es", options={"k": 1})
    (bed,) = [one for one in live.explain("stove", top=1).without if one.left_out == "indicator"]
    assert (bed.what, bed.moved) == (
        "bed",
        pytest.approx(distance(np.array(VECTORS[BED]), np.array(VECTORS[KETTLE]))),
    )
    assert [(change.query, change.lost, change.added) for change in bed.changes] == [
        (("stove", "atLocation", "?"), ["bedroom"], ["kitchen"]),
        (("stove", "hasAffordance", "?"), ["lie on"], ["turn on"]),
    ]


def test_without_its_only_piece_nothing_is_inserted(home: LiveEmbedding) -> None:
    home.insert("stove")
    words = [one for one in home.explain("stove").without if one.left_out == "words"]
    assert [(one.what, one.cosine, one.moved) for one in words] == [("stove", None, None)]


# Interference


def test_interference_of_all_and_of_one_is_that_of_the_library(home: LiveEmbedding) -> None:
    assert home.interference() is None
    home.insert("stove", FACTS, initializer="mean")
    alone = home.interference()
    home.insert("hob", [HOB], initializer="neighbour_mean")
    assert home.interference(["stove"]) == alone
    both, now = home.interference(), home.now
    assert (both, alone) != (None, None)
    known = small().triples
    scores = torch.einsum(
        "hd,rd,td->hrt", *map(torch.tensor, (now.entities, now.relations, now.entities))
    ).numpy()
    true = set(map(tuple, now.triples.tolist()))
    for new, measured in ((range(6, 8), both), (range(6, 7), alone)):
        ranks = []
        for last in (range(6), [*range(6), *new]):
            for h, r, t in known.tolist():
                for cells in ([(e, r, t) for e in last], [(h, r, e) for e in last]):
                    wrong = [scores[cell] for cell in cells if cell not in true]
                    own = scores[h, r, t]
                    ranks.append(
                        1
                        + sum(score > own for score in wrong)
                        + sum(score == own for score in wrong) / 2
                    )
        before, after = np.split(1 / np.array(ranks), 2)
        assert (measured.h_old, measured.h_cur) == pytest.approx((before.mean(), after.mean()))  # type: ignore[union-attr]
    assert LiveEmbedding(small(triples=np.zeros((0, 3), np.int64))).interference() is None


# Folders


def test_a_folder_grows_by_lines_of_its_journal_and_a_copy_has_all(tmp_path: Path) -> None:
    folder = written(tmp_path / "home", worded(tmp_path, stove=WORD))
    before = files(folder)
    live = isi.open(folder)
    live.insert("stove", FACTS[:1])
    assert files(folder) == before
    live.save()
    first = (folder / "journal.jsonl").read_bytes()
    live.observe(FACTS[1:])
    live.save()
    live.save()
    after = files(folder)
    journal = after.pop("journal.jsonl")
    assert after == before
    assert journal.startswith(first)
    assert [json.loads(line)["do"] for line in journal.splitlines()] == [
        "choose",
        "insert",
        "choose",
        "observe",
    ]
    live.save(tmp_path / "copy")
    for path in (folder, tmp_path / "copy"):
        again = isi.open(path)
        assert again.history == live.history
        assert again.now.entities.tobytes() == live.now.entities.tobytes()
        assert again.ask("stove", "atLocation") == live.ask("stove", "atLocation")
        assert again.explain("stove") == live.explain("stove")
    again.undo()
    again.undo()
    assert again.now.named_triples() == small().named_triples()


def state(live: LiveEmbedding) -> tuple[list[str], list[Fact], int]:
    """The inserted entities, all facts that hold, and the number of facts of training."""
    return list(live.inserted), sorted(live.now.named_triples()), len(live.base.triples)


@pytest.mark.parametrize(
    "changes",
    [
        lambda live: live.remove(facts=[("kettle", "atLocation", "bedroom")]),
        lambda live: live.move("kettle", "atLocation", "kitchen"),
        lambda live: live.undo(),
        lambda live: (live.undo(), live.undo()),
        lambda live: live.remove("stove"),
        lambda live: live.remove(facts=[FACTS[0], ("kettle", "atLocation", "kitchen")]),
    ],
)
@pytest.mark.parametrize("copied", [False, True])
def test_a_folder_has_the_same_state_after_it_is_compacted(
    tmp_path: Path, copied: bool, changes: Any
) -> None:
    live = isi.open(written(tmp_path / "home", without_words()))
    live.insert("stove", FACTS, initializer="mean")
    live.observe([("kettle", "atLocation", "bedroom")])
    # the tables of a copy have the insertion and the fact, too
    live.save(tmp_path / "copy" if copied else None)
    folder = tmp_path / ("copy" if copied else "home")
    with isi.open(folder, journal=True) as live:
        changes(live)
        before = state(live)
        assert live.compact() >= 0
        assert state(live) == before
        assert live.compact() == 0
        assert isi.open(folder).history == live.history
        if live.additions.done:
            live.undo()
        before = state(live)
    assert state(isi.open(folder)) == before


def test_what_was_inserted_again_in_another_way_is_not_read_from_the_old_row(
    tmp_path: Path,
) -> None:
    live = LiveEmbedding(without_words())
    live.insert("stove", FACTS, initializer="rs", options={"k": 1})
    live.save(tmp_path / "home")
    for about in (
        {"initializer": "mean"},
        {"initializer": "rs"},
        {"initializer": "rs", "kind": "room"},
    ):
        live = isi.open(tmp_path / "home")
        live.remove("stove")
        live.insert("stove", FACTS, **about)  # type: ignore[arg-type]
        live.save()
        again = isi.open(tmp_path / "home")
        assert vector(again).tobytes() == vector(live).tobytes()
        assert again.inserted["stove"].kind == live.inserted["stove"].kind


def test_a_file_of_words_serves_all_names_and_is_recorded(tmp_path: Path) -> None:
    path = Path(str(worded(tmp_path, stove=WORD).manifest.words.source))  # type: ignore[union-attr]
    folder = written(tmp_path / "home", without_words())
    live = isi.open(folder, vectors=path)
    live.insert("stove")
    live.save(tmp_path / "copy")
    bundle = read(tmp_path / "copy")
    assert bundle.manifest.words == WordSource(source=str(path), text="phrase", model=None)
    again = isi.open(tmp_path / "copy")
    assert vector(again).tobytes() == vector(live).tobytes() == by_library([]).tobytes()
    path.unlink()  # then the vocabulary that ships takes its place, for all
    later, fresh = isi.open(tmp_path / "copy"), isi.open(folder)
    fresh.insert("stove")
    assert vector(later).tobytes() == vector(fresh).tobytes() != vector(live).tobytes()
    assert later.base.words.shape != (6, 3)  # type: ignore[union-attr]


def test_of_two_copies_in_memory_one_is_saved_and_the_other_is_refused(tmp_path: Path) -> None:
    folder = written(tmp_path / "home")
    first, second = isi.open(folder), isi.open(folder)
    for live in (first, second):
        live.insert("hob", [HOB])
    first.save()
    before = files(folder)
    with pytest.raises(InputError):
        second.save()
    assert files(folder) == before
    first.undo()
    first.save()  # its own changes are no reason
    assert not isi.open(folder).inserted


def test_a_folder_is_open_for_changes_in_one_process_and_stays_as_it_was_without_one(
    tmp_path: Path,
) -> None:
    folder = written(tmp_path / "home")
    before = files(folder)
    with isi.open(folder, journal=True) as live:
        with pytest.raises(InputError):
            live.insert("hob", [("hob", "atLocation", "attic")])
        with pytest.raises(InputError, match="another process"):
            isi.open(folder, journal=True)
        assert files(folder) == before
        live.insert("hob", [HOB])
        assert list(isi.open(folder).inserted) == ["hob"]  # at once
    with isi.open(folder, journal=True) as live:
        live.undo()
    assert not isi.open(folder).inserted


@pytest.mark.parametrize(
    "change",
    [
        lambda live: live.insert("hob", [("hob", "atLocation", "attic")]),
        lambda live: live.insert("qzx"),
        lambda live: live.insert("hob", [("kettle", "atLocation", "attic")]),
        lambda live: live.observe([HOB]),
        lambda live: live.insert("hob", [HOB], kind="animal"),
        lambda live: live.remove("kettle"),
        lambda live: live.remove(facts=[("kettle", "atLocation", "bedroom")]),
        lambda live: live.remove(facts=[HOB]),
        lambda live: live.insert("hob", [HOB], initializer="rs", options={"k": 0}),
        lambda live: live.insert("hob", [("hob", "atLocation", "stove")], initializer="mean"),
        lambda live: live.insert(["hob", "hob"], [HOB, ("hob", "atLocation")]),
        lambda live: live.ask("stove"),
        lambda live: live.ask("stove", "atLocation", "kitchen"),
        lambda live: live.explain("kettle"),
        lambda live: live.observe([("kettle", "atLocation", "bedroom")], time="noon"),
        lambda live: live.insert("hob", [HOB], source="two\nlines"),
        lambda live: live.undo(source="a\tb"),
        lambda live: live.remove(facts=[FACTS[0]], time=True),
        lambda live: live.move("kettle", "atLocation", "bedroom", time=float("inf")),
        lambda live: live.insert(["hob", "Hob"], [HOB, ("Hob", "atLocation", "kitchen")]),
        lambda live: live.insert(
            ["gas hob", "gas_hob"], [("gas hob", "atLocation", "kitchen")], initializer="mean"
        ),
        lambda live: live.insert("hob", [HOB], kind={"hbo": "object"}),
        lambda live: live.insert(["hob"], [HOB], definition={"Hob": "a stove"}),
    ],
)
def test_a_mistake_changes_nothing(home: LiveEmbedding, change: Any) -> None:
    home.insert("stove", FACTS)
    before, history = home.now, home.history
    with pytest.raises(InputError):
        change(home)
    assert (home.now, home.history) == (before, history)
