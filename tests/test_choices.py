"""Choices of initializers: nobody waits while one is made, and a question makes none."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

import isi
from isi.home import choosing
from isi.home.choices import PREPARED
from isi.home.home import Home
from isi.home.inserted import Choice
from tests.small_bundle import home_of, opened, small
from tests.small_home import KNOWN, assert_same, seen

pytestmark = pytest.mark.usefixtures("quick")
MUG, TRAY = ("mug", "in", "e1"), ("tray", "in", "e2")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return home_of(tmp_path / "home", KNOWN)


def choosing_after(act: Callable[[], Any]) -> Any:
    """A patch: before a choice is made, something is done."""
    choose = choosing.choose

    def after(*arguments: Any) -> Choice:
        act()
        return choose(*arguments)

    return patch.object(choosing, "choose", after)


def test_while_a_choice_is_made_others_tell_and_ask(folder: Path) -> None:
    home, other = isi.open(folder), isi.open(folder)
    waited = list[float]()

    def beside() -> None:
        start = time.monotonic()
        other.tell([("e3", "in", "e4")])
        other.ask("e3", "in")
        with ThreadPoolExecutor() as thread:  # of the process that makes the choice
            assert thread.submit(home.ask, "e3", "in").result(timeout=20).answers
        waited.append(time.monotonic() - start)

    with choosing_after(beside):
        assert home.tell(iter([MUG])).inserted == ["mug"]
    assert len(waited) == 1
    assert waited[0] < 30  # a lock is waited for up to a minute
    alone = Home(KNOWN)
    alone.tell([("e3", "in", "e4"), MUG])
    assert_same(seen(home), seen(alone))
    assert_same(seen(other), seen(alone))


def test_while_a_choice_is_made_for_a_new_training_others_tell(folder: Path) -> None:
    home, other = isi.open(folder), isi.open(folder)
    home.tell([MUG])
    larger = replace(KNOWN, entities=2 * KNOWN.entities)
    new = list[tuple[str, ...]]([TRAY])
    with choosing_after(lambda: new and other.tell([new.pop()])):
        home.train_again(larger)
    told = Home(larger)
    told.tell([MUG])
    told.tell([TRAY])
    assert_same(seen(home), seen(told))
    assert_same(seen(other), seen(told))


def test_training_while_a_choice_is_made_lets_the_change_begin_again(folder: Path) -> None:
    home, other = isi.open(folder), isi.open(folder)
    larger = replace(KNOWN, entities=2 * KNOWN.entities)
    trainings = [larger]
    with choosing_after(lambda: trainings and other.train_again(trainings.pop())):
        home.tell([MUG])
    told = Home(larger)
    told.tell([MUG])
    assert_same(seen(home), seen(told))


def test_a_question_makes_no_choice_and_writes_nothing(folder: Path) -> None:
    with isi.open(folder) as home:
        home.tell([MUG])
        home.database.execute("DELETE FROM choice")
    with (
        patch.object(choosing, "choose", None),
        isi.open(folder) as home,
        home.database.transaction(),  # another connection could not write now
        isi.open(folder) as other,
    ):
        answers = other.ask("mug", "in").answers
        assert {each.probability for each in answers if not each.known} <= {None, 0.0}
        assert other.explain("mug").indicators
        assert other.nearest("mug")
        assert other.history()
        assert other.facts("mug")


def test_names_with_and_without_words_are_prepared() -> None:
    unworded = Home(KNOWN)
    unworded.prepare()
    numbers = [(number, 0) for number in PREPARED]
    assert unworded.database.rows("SELECT facts, words FROM choice ORDER BY facts") == numbers
    home = Home(opened(triples=small().triples))
    home.prepare()
    numbers = [(number, words) for number in PREPARED for words in (0, 1)]
    rows = home.database.rows("SELECT facts, words FROM choice ORDER BY facts, words")
    assert rows == numbers
    with patch.object(choosing, "choose", None):
        home.tell([("stove", "atLocation", "kitchen"), ("q17 55", "atLocation", "bedroom")])
    assert not home.derived.choices.preparation()


def test_an_initializer_that_needs_words_serves_no_names_without() -> None:
    base = opened()
    by_words = Choice("soft_es", {"temperature": 0.1}, "the best", "logistic", (), None)
    assert choosing.choose(base, (1, True, ""), by_words).initializer == "soft_es"
    assert choosing.choose(base, (1, False, ""), by_words).initializer != "soft_es"


def test_an_initializer_that_starts_from_words_starts_without_them_from_its_own() -> None:
    options = {"share": 0.7, "epochs": 10, "rate": 0.25, "pull": 1.0, "start": "soft_hybrid"}
    folded = Choice("fold_in", options, "the best", "logistic", (), None)
    without = choosing.choose(opened(), (1, False, ""), folded)
    assert without.options == options | {"start": "soft_rs"}
    assert without.why == "the best"
