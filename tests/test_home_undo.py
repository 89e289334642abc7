"""A change that is not the last one is taken back as if it had not been made, or is refused."""

from typing import Any

import pytest

from isi.errors import InputError
from isi.home.home import Home
from tests.small_home import KNOWN, TRAINED

pytestmark = pytest.mark.usefixtures("quick")
OLD, NEW = TRAINED[0], ("e1", "on", "e20")


def day(number: int) -> str:
    return f"2026-01-{number:02}T12:00:00Z"


@pytest.fixture
def home() -> Home:
    return Home(KNOWN)


def row_of(home: Home, fact: Any) -> tuple[Any, ...]:
    row = home.database.fact(fact)
    assert row is not None
    return row.status, row.count, row.confidence, row.first_seen, row.last_seen, row.source


@pytest.mark.parametrize("fact", [OLD, NEW])
def test_what_others_have_seen_since_stays_as_they_have_told_it(home: Home, fact: Any) -> None:
    status, before = ("trained", 1) if fact == OLD else ("added", 0)
    home.tell([fact], time=day(1), source="camera", confidence=0.5)
    home.tell([fact], time=day(3), source="Ann")
    home.tell([fact], time=day(2), confidence=0.9)
    assert row_of(home, fact) == (status, before + 3, 0.9, day(1), day(3), "Ann")
    home.undo(source="camera")
    assert row_of(home, fact) == (status, before + 2, 0.9, day(2), day(3), "Ann")
    home.undo(source="Ann")
    assert row_of(home, fact) == (status, before + 1, 0.9, day(2), day(2), None)
    home.undo()
    expected = [(OLD, ("trained", 1, None, None, None, None))] if fact == OLD else []
    assert [(row.fact, row_of(home, fact)) for row in home.facts() if row.fact == fact] == expected


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("tell", [NEW]), ("remove", (), [NEW])),
        (("remove", (), [OLD]), ("tell", [OLD])),
        (("move", "e0", "in", "e5"), ("move", "e0", "in", "e6")),
        (("tell", [("mug", "in", "e1")]), ("tell", [("mug", "on", "e2")])),
        (("tell", [("mug", "in", "e1")]), ("remove", "mug")),
        (("tell", [("e1", "by", "e2"), ("e2", "by", "e3")]), ("tell", [("e3", "by", "e4")])),
    ],
)
def test_a_change_on_which_another_stands_is_taken_back_after_it(
    home: Home, first: Any, second: Any
) -> None:
    states = []
    for verb, *arguments in (first, second):
        states.append((home.facts(), list(home.inserted), home.database.relations()))
        getattr(home, verb)(*arguments)
    one, two = (change.id for change in home.history())
    with pytest.raises(InputError, match=f"undo {two} first"):
        home.undo(change=one)
    for number, expected in zip((two, one), reversed(states), strict=True):
        home.undo(change=number)
        assert (home.facts(), list(home.inserted), home.database.relations()) == expected
        with pytest.raises(InputError, match=f"change {number}"):
            home.undo(change=number)


def test_what_is_taken_back_is_listed_as_what_it_did(home: Home) -> None:
    home.tell([NEW, ("mug", "in", "e1"), OLD], source="camera")
    home.tell([NEW], source="Ann")
    home.tell([TRAINED[1]])
    with pytest.raises(InputError, match="no change of 'Bob'"):
        home.undo(source="Bob")
    effect = home.undo(source="camera")
    assert (effect.removed, effect.lost) == (["mug"], [("mug", "in", "e1")])
    *_, undone = home.history()
    assert (undone.removed, undone.lost) == (effect.removed, effect.lost)
    assert set(undone.unseen) == {NEW, OLD}
    seen = next(change for change in home.history() if change.source == "Ann")
    assert (seen.added, seen.seen) == ([NEW], [])  # Ann's word alone is left
