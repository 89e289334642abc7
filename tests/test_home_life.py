"""What a home keeps of facts, how it is asked, trained again, copied and closed."""

import dataclasses
import os
import time
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import isi
from isi.errors import InputError
from isi.home.bundle import Bundle
from isi.home.choices import Choices
from isi.home.groups import EntityGroups
from isi.home.home import Home
from isi.home.phrases import with_words
from tests.small_bundle import files, home_of, small, word_file, worded
from tests.small_home import KNOWN, TRAINED, assert_same, facts_of, seen

pytestmark = pytest.mark.usefixtures("quick")
MUG = ("mug", "in", "e1")
FIRST = TRAINED[0]


@pytest.fixture
def home() -> Home:
    return Home(KNOWN)


# What is known of facts


@pytest.mark.parametrize(
    ("given", "hour"),
    [
        (datetime(2026, 1, 5, 20, 52), 1),
        ("2026-01-05T20:52", 1),
        ("2026-01-05T20:52:00+00:00", 20),
        (datetime(2026, 1, 5, 20, 52, tzinfo=UTC), 20),
        (datetime(2026, 1, 5, 20, 52, tzinfo=UTC).timestamp(), 20),
    ],
)
def test_a_time_without_a_zone_is_local_time(
    home: Home, monkeypatch: pytest.MonkeyPatch, given: Any, hour: int
) -> None:
    with monkeypatch.context() as context:
        context.setenv("TZ", "America/New_York")
        time.tzset()
        home.tell([MUG], time=given)
    time.tzset()
    expected = datetime(2026, 1, 6 if hour == 1 else 5, hour, 52, tzinfo=UTC)
    assert home.history()[-1].time == expected


def test_a_doubtful_fact_moves_the_vector_of_map_less(home: Home) -> None:
    def vector(*facts: Any) -> np.ndarray:
        home.tell([("mug", "on", "e7"), *facts], initializer="map")
        row = home.inserted["mug"].vector
        home.undo()
        return row

    without, doubtful, sure = vector(), vector((*MUG, 0.1)), vector(MUG)
    assert 0 < np.linalg.norm(doubtful - without) < np.linalg.norm(sure - without)
    for wrong in (0, 1.5, float("nan"), "much"):
        with pytest.raises(InputError, match="confidence"):
            home.tell([(*MUG, wrong)])


def test_the_row_of_a_new_relation_follows_from_its_facts_and_goes_by_undo(
    home: Home, tmp_path: Path
) -> None:
    before = seen(home)
    home.tell([("e1", "near", "e2"), ("e3", "near", "e4"), ("mug", "near", "e2"), MUG])
    assert home.ask("e1", "near").answers[0].entity == "e2"
    first = home.now.relations[2]
    home.tell([("e5", "near", "e2")])  # known now: one fact will do, and counts
    assert (home.now.relations[2] != first).any()
    home.save(tmp_path / "copy")
    with isi.open(tmp_path / "copy") as again:
        np.testing.assert_array_equal(again.now.relations, home.now.relations)
    for _ in range(2):
        home.undo()
    assert_same(seen(home), before)
    assert len(home.now.relations) == 2


# Changes that are taken back


def test_what_a_camera_takes_back_leaves_the_word_of_a_person(home: Home) -> None:
    home.tell([MUG], source="camera")
    home.tell([("mug", "on", "e2"), ("e1", "on", "e9")], source="Ann")
    with pytest.raises(InputError, match="undo 3 first"):  # the mug is there by the first change
        home.undo(source="camera")
    home.tell([("e3", "on", "e5")], source="camera")
    before = seen(home), facts_of(home), len(home.history())
    effect = home.undo(source="camera", dry=True)
    assert (effect.lost, effect.facts) == ([("e3", "on", "e5")], 0)
    assert (facts_of(home), len(home.history())) == before[1:]
    assert home.undo(source="camera").lost == effect.lost
    assert {*home.undo(change=3).lost} == {("mug", "on", "e2"), ("e1", "on", "e9")}
    for wrong in ({"change": 3}, {"change": 99}, {"source": "Ann"}):
        with pytest.raises(InputError):
            home.undo(**wrong)


def test_what_is_forgotten_holds_and_cannot_be_undone(tmp_path: Path) -> None:
    with isi.open(home_of(tmp_path / "home", KNOWN)) as home:
        home.tell([MUG])
        before = seen(home), facts_of(home)
        time.sleep(1.1)  # times are whole seconds
        assert home.forget("0s") == 1
        assert [change.verb for change in home.history()] == ["forget"]
        with pytest.raises(InputError):
            home.undo()
        assert_same(seen(home), before[0])
        assert facts_of(home) == before[1]


# Questions


@pytest.mark.parametrize(
    ("call", "name", "wrong"),
    [
        ("ask mug in", "top", 0),
        ("nearest mug", "top", 0),
        ("interference", "most", 0),
        ("interference", "show", -1),
    ],
)
def test_numbers_of_answers_are_refused_unless_they_are_counts(
    home: Home, call: str, name: str, wrong: int
) -> None:
    home.tell([MUG])
    verb, *names = call.split()
    asked = partial(getattr(home, verb), *names)
    for number in (wrong, -1, 2.5, True, "3", None):
        with pytest.raises(InputError, match=f"argument '{name}'"):
            asked(**{name: number})
    assert asked(**{name: np.int64(1)})


def test_without_kinds_of_objects_a_new_object_has_none() -> None:
    kinds = ["room", "room", "", "", "affordance", "affordance"]
    home = Home(small(kinds=kinds))
    for fact in (("stove", "atLocation", "kitchen"), ("stove", "hasAffordance", "turn on")):
        home.tell([fact], initializer="mean")
        assert home.inserted["stove"].kind == ""
        home.undo()
    assert home.ask("kettle", "atLocation").answers


def test_names_are_told_as_the_embedding_writes_them() -> None:
    names = ["cafe\u0301", *KNOWN.entity_names[1:]]
    home = Home(replace(KNOWN, entity_names=names))
    composed = "caf\u00e9"
    effect = home.tell([(composed, "in", "e3"), (f"{composed} mug", "in", names[0])])
    assert effect.inserted == [f"{composed} mug"]
    assert home.tell([(f"{names[0]} mug ", "in", composed)]).seen == 1
    assert not home.tell(entities=f"{names[0]} mug").inserted
    assert home.ask(composed, "in").answers[0].given
    assert home.remove(f"{names[0]} mug").removed == [f"{composed} mug"]


# Word vectors of a file


def test_word_vectors_of_a_file_are_found_from_any_folder_or_are_said_to_be_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bundle = worded(Path(), stove=[0.6, 0.8, 0.0])
    source = bundle.manifest.words.source  # type: ignore[union-attr]
    folder = home_of(tmp_path / "home", with_words(bundle, Path(source)))
    (tmp_path / "elsewhere").mkdir()
    os.chdir(tmp_path / "elsewhere")
    with isi.open(folder) as home:
        home.tell(entities="stove")
        assert "words.txt" in home.explain("stove").words
        vector = home.inserted["stove"].vector
    for row in ([0.0, 0.6, 0.8], [0.6, 0.8]):  # other vectors; of another width
        word_file(tmp_path / source, {"stove": row, "oven": row})
        with isi.open(folder) as home:
            effect = home.tell({"oven": {"atLocation": "kitchen"}}, initializer="mean")
            assert any("words.txt is not the file" in note for note in effect.notes)
            home.undo()
    Path(tmp_path / source).unlink()
    with isi.open(folder) as home:
        np.testing.assert_array_equal(home.inserted["stove"].vector, vector)
        effect = home.tell({"oven": {"atLocation": "kitchen"}}, initializer="mean")
        assert any("words.txt" in note and "not there" in note for note in effect.notes)
        with pytest.raises(InputError, match=r"words\.txt"):
            home.tell(entities="hob")


# Trained again, copied, closed


def trained_on(home: Home) -> Bundle:
    """What training on all that holds may give: inserted entities have rows as others."""
    fields = {field.name: getattr(home.now, field.name) for field in dataclasses.fields(Bundle)}
    return Bundle(**fields | {"counts": None})


def test_a_home_that_is_trained_again_keeps_what_is_known_and_what_came_meanwhile(
    tmp_path: Path,
) -> None:
    folder = home_of(tmp_path / "home", KNOWN)
    home, other = isi.open(folder), isi.open(folder)
    home.tell([MUG, ("mug", "on", "e2"), FIRST], confidence=0.5, source="camera")
    home.tell([("e1", "on", "e20"), ("e1", "on", "e21")])
    home.remove(facts=[TRAINED[1]])
    bundle = trained_on(home)
    other.tell([("mug", "on", "e9"), ("tray", "in", "e3")], initializer="mean")
    other.remove(facts=[("e1", "on", "e20"), TRAINED[2]])
    known, changes = facts_of(other), len(other.history())
    home.train_again(bundle)
    for each in (home, other, isi.open(folder)):
        assert facts_of(each) == known
        assert each.history()[-1].verb == "train"
        assert len(each.history()) == changes + 1
        assert list(each.inserted) == ["tray"]
        assert each.base.kinds == bundle.kinds
        assert each.database.fact(MUG).status == "trained"  # type: ignore[union-attr]
        with pytest.raises(InputError, match="no change"):
            each.undo()
    assert_same(seen(home), seen(other))
    home.tell([("tray", "on", "mug")])
    assert ("tray", "on", "mug") in facts_of(other)


@pytest.mark.parametrize("in_memory", [True, False])
def test_a_training_that_is_stopped_leaves_a_home_as_it_was(
    tmp_path: Path, in_memory: bool
) -> None:
    home = Home(KNOWN) if in_memory else isi.open(home_of(tmp_path / "home", KNOWN))
    home.tell([MUG])
    before = seen(home)
    larger = replace(KNOWN, entities=2 * KNOWN.entities)
    stopped = patch.object(EntityGroups, "insert", side_effect=KeyboardInterrupt)
    with stopped, pytest.raises(KeyboardInterrupt):
        home.train_again(larger)
    assert_same(seen(home), before)
    home.tell([("tray", "in", "e3")])
    home.undo()
    assert_same(seen(home), before)


def test_a_taking_over_that_is_stopped_is_made_by_the_next_question(tmp_path: Path) -> None:
    folder = home_of(tmp_path / "home", KNOWN)
    home, other = isi.open(folder), isi.open(folder)
    home.tell([MUG])
    seen(other)
    larger = replace(KNOWN, entities=2 * KNOWN.entities)
    home.train_again(larger)
    stopped = patch.object(Choices, "__init__", side_effect=KeyboardInterrupt)
    with stopped, pytest.raises(KeyboardInterrupt):
        other.ask("e1", "in")
    told = Home(larger)
    for each in (other, told):
        each.tell([MUG, ("tray", "in", "e3")])
    assert_same(seen(other), seen(told))
    assert_same(seen(home), seen(told))


@pytest.mark.filterwarnings("ignore")  # it has learned nothing
def test_training_of_a_home_is_on_all_that_holds(tmp_path: Path) -> None:
    rows = [(f"thing {each}", "at", f"room {each % 4}") for each in range(12)]
    kinds = {end: end.split()[0] for row in rows for end in (row[0], row[2])}
    trained = isi.train(rows, kinds=kinds, dimension=4)
    trained.save(tmp_path / "home")
    with isi.open(tmp_path / "home") as home:
        home.tell([("mug", "at", "room 1"), ("mug", "by", "room 2"), ("thing 1", "by", "room 2")])
        home.tell(rows[:1])
        home.remove(facts=[rows[1]])
        known = facts_of(home)
        assert isi.train(home, dimension=4) is home
        assert facts_of(home) == known
        assert (home.base.kinds[home.base.names.ids["mug"]], home.inserted) == ("thing", {})
        assert home.base.relation_names == ["at", "by"]
        assert ("thing 1", "at", "room 1") not in home.base.named_triples()


def test_what_is_done_with_a_closed_home_is_refused_and_loses_nothing(tmp_path: Path) -> None:
    folder = home_of(tmp_path / "home", KNOWN)
    with isi.open(folder) as home:
        home.tell([MUG])
    with isi.open(folder) as other:
        other.tell([("cup", "in", "e2")])
    before = files(folder)
    for work in (
        partial(home.tell, [MUG]),
        partial(home.move, *MUG),
        partial(home.remove, "mug"),
        home.undo,
        partial(home.ask, *MUG[:2]),
        partial(home.save, tmp_path / "copy"),
        home.prepare,
    ):
        with pytest.raises(InputError, match="closed"):
            work()
    home.close()
    assert files(folder) == before
    assert list(isi.open(folder).inserted) == ["mug", "cup"]


def test_how_durable_changes_are_is_told_when_a_home_is_opened(tmp_path: Path) -> None:
    folder = home_of(tmp_path / "home", KNOWN)
    with isi.open(folder) as home:
        assert home.database.rows("PRAGMA synchronous") == [(2,)]
    with isi.open(folder, durability="memory") as home:
        home.tell([MUG])
    assert not isi.open(folder).inserted
    with pytest.raises(InputError, match="durability"):
        isi.open(folder, durability="sometimes")  # type: ignore[arg-type]
