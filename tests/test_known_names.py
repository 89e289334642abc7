"""The one vocabulary of names and ids: which name a text is or may mean; triples as ids."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.home.home import Home
from isi.vocabulary import Vocabulary, ids_by_name, numbered
from tests.small_bundle import NAMES, opened


@pytest.mark.parametrize(
    ("known", "text"),
    [
        *[("turn on", text) for text in ("Turn On", "turnOn", "turn_on", "turn-on", "TURNON")],
        ("mW", "MW"),
        ("chair_1_12", "Chair 1 12"),
        ("room 2B", "room_2b"),
    ],
)
def test_a_question_finds_a_name_without_regard_to_case_and_gaps_and_says_so(
    known: str, text: str
) -> None:
    names, notes = Vocabulary("entity", ["turn off", known]), list[str]()
    assert names.queried(text, notes.append) == known
    (note,) = notes
    assert repr(known) in note
    assert repr(text) in note
    with pytest.raises(InputError, match=f"did you mean {known!r}"):
        names.find(text, "PLACE")


@pytest.mark.parametrize(
    ("known", "text"),
    [
        ("10", "-10"),
        ("5", "+5"),
        ("2021-11-2", "2021-1-12"),
        ("112", "11 2"),
        ("chair_1_12", "chair_11_2"),
        ("a1", "a-1"),
        ("x 1", "x1"),
        ("-x", "x"),
        ("a²-³", "a²³"),
    ],
)
def test_names_that_differ_in_signs_or_between_digits_are_two_entities(
    known: str, text: str
) -> None:
    for one, other in ((known, text), (text, known)):
        names = Vocabulary("entity", [one])
        with pytest.raises(InputError, match="did you mean"):
            names.queried(other, pytest.fail)
        home = Home(opened(entity_names=[*NAMES[:-1], one]))
        with pytest.raises(InputError, match="did you mean"):
            home.tell([(other, "atLocation", "kitchen")], new="refuse")
        assert home.tell([(other, "atLocation", "kitchen")]).inserted == [other]
        assert home.ask(other, "atLocation").query[0] == other
        assert home.remove(other).removed == [other]


def test_a_name_as_it_is_written_goes_first_and_none_is_guessed() -> None:
    names = Vocabulary("entity", ["Apple", "apple"])
    assert names.queried("apple", pytest.fail) == "apple"
    for text, hint in (("APPLE", "'apple'"), ("aple", "'apple'"), ("zz", "'apple'")):
        with pytest.raises(InputError, match=f"^entity: .*{hint}|{hint}.*{text}"):
            names.queried(text, pytest.fail)


@pytest.mark.parametrize("verb", ["tell", "move", "ask", "facts"])
def test_names_of_a_detector_are_understood_by_every_verb_alike(verb: str) -> None:
    home = Home(opened())
    home.tell([("gas hob", "atLocation", "kitchen")])
    typed = ("GasHob", "at_location", "BedRoom")
    result = {
        "tell": partial(home.tell, [typed]),
        "move": partial(home.move, *typed),
        "ask": partial(home.ask, *typed[:2]),
        "facts": partial(home.facts, typed[0]),
    }[verb]
    if verb == "facts":
        with pytest.warns(UserWarning, match="'GasHob' is taken for 'gas hob'"):
            assert [row.fact for row in result()] == [("gas hob", "atLocation", "kitchen")]
        return
    assert "'GasHob' is taken for 'gas hob'" in result().notes
    assert "'at_location' is taken for 'atLocation'" in result().notes
    assert list(home.inserted) == ["gas hob"]
    assert {row.fact[:2] for row in home.facts("gas hob")} == {("gas hob", "atLocation")}


@pytest.mark.parametrize("name", ["kettles", "copper kettle", "kettle 2", "ketle"])
def test_a_name_that_differs_otherwise_is_new_or_refused_if_asked_for(name: str) -> None:
    home = Home(opened())
    with pytest.raises(InputError, match=name):
        home.tell([(name, "atLocation", "kitchen")], new="refuse")
    assert home.tell([(name, "atLocation", "kitchen")]).inserted == [name]


def test_of_spellings_of_a_new_name_the_first_counts_and_of_known_ones_none_is_chosen() -> None:
    home = Home(opened(entity_names=[*NAMES[:-2], "mW", "MW"]))
    facts = [("GasHob", "atLocation", "kitchen"), ("gas hob", "hasAffordance", "bedroom")]
    assert home.tell(facts).inserted == ["GasHob"]
    for verb in (home.tell, home.remove):
        with pytest.raises(InputError, match="'mW', 'MW'"):
            verb(facts=[("mw", "atLocation", "kitchen")])
    with pytest.raises(InputError, match="'mW', 'MW'"):
        home.ask("mw", "atLocation")
    assert home.ask("MW", "atLocation").query[0] == "MW"


def test_what_is_moved_to_a_new_place_inserts_it_and_what_is_not_known_is_not_moved() -> None:
    home = Home(opened())
    home.tell([("gas hob", "atLocation", "kitchen")])
    effect = home.move("gas hob", "atLocation", "Garage")
    assert (effect.inserted, effect.lost) == (["Garage"], [("gas hob", "atLocation", "kitchen")])
    for wrong in (("tray", "atLocation", "kitchen"), ("gas hob", "above", "kitchen")):
        with pytest.raises(InputError):
            home.move(*wrong)
    assert home.undo().removed == ["Garage"]


def test_a_fact_of_a_functional_relation_takes_the_place_of_others() -> None:
    bundle = opened()
    manifest = bundle.manifest.model_copy(update={"functional": ["atLocation"]})
    home = Home(replace(bundle, manifest=manifest))
    home.tell([("gas hob", "atLocation", "kitchen"), ("gas hob", "hasAffordance", "turn on")])
    assert home.tell([("gas hob", "atLocation", "bedroom")]).lost == [
        ("gas hob", "atLocation", "kitchen")
    ]
    assert {row.fact[1:] for row in home.facts("gas hob")} == {
        ("atLocation", "bedroom"),
        ("hasAffordance", "turn on"),
    }
    with pytest.raises(InputError, match="one tail of atLocation"):
        home.tell({"tray": {"atLocation": ["kitchen", "bedroom"]}})


@pytest.mark.parametrize("form", [" gas hob", "gas\u200b hob", "gas\u00a0hob"])
def test_forms_of_a_name_in_one_change_are_one_entity(form: str) -> None:
    home = Home(opened())
    facts = [("gas hob", "atLocation", "kitchen"), (form, "hasAffordance", "turn on")]
    effect = home.tell(facts, kind={form: "object"})
    assert (effect.inserted, effect.facts) == (["gas hob"], 2)
    assert home.inserted["gas hob"].kind == "object"


@pytest.mark.parametrize(
    ("new", "known", "expected"),
    [
        ("disease_or_syndrom", "disease_or_syndrome", True),
        ("Kitchen", "kitchen", True),
        ("forks", "fork", True),
        ("living-room", "living room", True),
        ("kithcen", "kitchen", True),
        ("kitchan", "kitchen", True),
        ("kitten", "kitchen", False),
        ("entity 12", "entity 13", False),
        ("entity 1", "entity 12", False),
        ("mug", "mud", False),
        ("cafe\u0301 bar table", "caf\u00e9 bar table", True),
    ],
)
def test_a_slip_of_the_pen_is_told_from_another_label(new: str, known: str, expected: bool) -> None:
    names = Vocabulary("entity", ["bed", known, "counter"])
    assert names.misspelt([new, "espresso"]) == ({new: known} if expected else {})


NAMES_OF_ROWS = st.lists(st.text("aAé1 _-s", max_size=4), unique=True, max_size=12)


@given(names=NAMES_OF_ROWS, known=st.integers(0, 12), text=st.text("aAé1 _-s", max_size=4))
def test_a_vocabulary_that_grows_is_that_of_all_names(
    names: list[str], known: int, text: str
) -> None:
    whole = Vocabulary("entity", names)
    grown = Vocabulary("entity", names[:known]).with_new(names[known:], "new")
    assert (grown.names, grown.ids, grown.number) == (whole.names, whole.ids, len(names))
    assert [grown.id(grown.of(row), "") for row in range(len(names))] == list(range(len(names)))
    for method in ("same", "meant", "hint"):
        assert getattr(grown, method)(text) == getattr(whole, method)(text)


@given(st.lists(st.tuples(*[st.sampled_from(["b", "a", "10", "9"])] * 3)))
def test_numbered_triples_have_the_names_of_their_ids(triples: list[tuple[str, str, str]]) -> None:
    listed = np.array(triples, object).reshape(-1, 3)
    for in_order in (False, True):
        ids, entities, relations = numbered(listed, in_order)
        names = np.stack([entities[ids[:, 0]], relations[ids[:, 1]], entities[ids[:, 2]]], 1)
        assert names.tolist() == listed.tolist()
        by_name = Vocabulary("entity", entities).ids, Vocabulary("relation", relations).ids
        np.testing.assert_array_equal(ids_by_name(triples, *by_name), ids)
        ends = [end for head, _, tail in triples for end in (head, tail)]
        expected = sorted(set(ends)) if in_order else list(dict.fromkeys(ends))
        assert entities.tolist() == expected


def test_new_names_are_refused_where_they_cannot_be_told_apart() -> None:
    known, unnamed = Vocabulary("relation", ["in", "on"]), Vocabulary("relation", None, 2)
    assert (known.with_new(0, "new").ids, unnamed.with_new(3, "new").number) == (known.ids, 5)
    for vocabulary, new, expected in (
        (known, ["at", "in"], "argument 'new': 'in': expected a new name: it is known already"),
        (known, ["at", "at"], "argument 'new': 'at': expected names that do not repeat"),
        (known, 1, "argument 'new': expected names where 'relation_names' are given"),
        (unnamed, ["at"], "argument 'new': expected names where 'relation_names' are given"),
        (unnamed, -1, "argument 'new': expected a number from 0 on, got -1"),
    ):
        with pytest.raises(InputError, match=f"^{expected}"):
            vocabulary.with_new(new, "new")
