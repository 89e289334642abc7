"""The one vocabulary of names and ids: which name a text is in facts, which one it may mean in a
question, which new one looks like it; triples of names as ids.
"""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.home.home import Home
from isi.names import plain
from isi.vocabulary import Vocabulary, ids_by_name, numbered, plurals, singulars
from tests.small_bundle import NAMES, opened, worded

IN_KITCHEN = {"atLocation": "kitchen"}


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
            home.observe([(other, "atLocation", "kitchen")])
        assert home.tell([(other, "atLocation", "kitchen")]).inserted == [other]
        assert home.ask(other, "atLocation").query[0] == other
        assert home.remove(other).removed == [other]


def test_a_name_as_it_is_written_goes_first_and_none_is_guessed() -> None:
    names = Vocabulary("entity", ["Apple", "apple"])
    assert names.queried("apple", pytest.fail) == "apple"
    both = "'Apple' or 'apple'"
    for text, hint in (("APPLE", both), ("aple", "'apple'"), ("zz", both)):
        with pytest.raises(InputError, match=f"^entity: .* got '{text}'.*{hint}"):
            names.queried(text, pytest.fail)


@pytest.mark.parametrize(
    "name", ["Kettle", "kettles", "KETTLES", "BedRoom", "turnOn", "copper kettle"]
)
def test_a_name_that_looks_like_a_known_one_is_refused_unless_it_is_new(
    tmp_path: Path, name: str
) -> None:
    home = Home(worded(tmp_path, **{"copper kettle": [0.95, 0.1, 0.1]}))
    for verb in (home.insert, home.tell):
        with pytest.raises(InputError, match=r"kettle|bedroom|turn on"):
            verb(*((name, IN_KITCHEN) if verb == home.insert else ({name: IN_KITCHEN},)))
    assert home.insert(name, IN_KITCHEN, new=True).inserted == [name]


def test_new_names_that_differ_in_case_are_told_together_where_that_is_meant() -> None:
    home = Home(opened(entity_names=[*NAMES[:-1], "mW"]))
    facts = [(name, "atLocation", "kitchen") for name in ("MW", "Co", "CO")]
    for names in (["Co", "CO"], ["MW"]):
        with pytest.raises(InputError, match=r"'Co'|'mW'"):
            home.insert(names, facts[1:] if "Co" in names else facts[:1])
    with pytest.warns(UserWarning, match="'MW' is not known.*'mW'"):
        home.nearest("MW")
    home.tell(facts, new=True)
    assert [home.ask(name, "atLocation").query[0] for name in ("MW", "CO")] == ["MW", "CO"]
    with pytest.raises(InputError, match="did you mean 'mW' or 'MW'"):
        home.ask("mw", "atLocation")  # one of two is not chosen


@pytest.mark.parametrize("form", [" gas hob", "gas\u200b hob", "gas\u00a0hob"])
def test_forms_of_a_name_in_one_change_are_one_entity(form: str) -> None:
    home = Home(opened())
    facts = [("gas hob", "atLocation", "kitchen"), (form, "hasAffordance", "turn on")]
    effect = home.tell(facts, kind={form: "object"})
    assert (effect.inserted, effect.facts) == (["gas hob"], 2)
    assert home.inserted["gas hob"].kind == "object"


@pytest.mark.parametrize(
    ("one", "several"),
    [
        ("fork", "Forks"),
        ("side table", "sideTables"),
        ("box", "boxes"),
        ("knife", "knives"),
        ("berry", "berries"),
        ("shelf", "shelves"),
        ("axe", "axes"),
        ("tomato", "tomatoes"),
    ],
)
def test_a_plural_has_the_singular_of_its_word(one: str, several: str) -> None:
    assert plain(one) in singulars(several)
    assert plain(several) in plurals(one)
    assert plain(several) not in singulars(one)


@pytest.mark.parametrize(("one", "other"), [("gas", "ga"), ("glass", "glas"), ("tubes", "tubs")])
def test_words_that_differ_otherwise_are_no_plurals_of_each_other(one: str, other: str) -> None:
    assert plain(other) not in singulars(one) | plurals(one)
    assert plain(one) not in singulars(other) | plurals(other)


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
    for method in ("same", "meant", "resembled", "hint"):
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
