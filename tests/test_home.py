"""Random sequences of changes of a home that two objects share: known rows stay, and facts, what is
known of them, vectors and answers follow from what was told, which is computed in a second way.
"""

import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import astuple
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

import isi
from isi.home.bundle import Fact
from isi.home.changes import Effect
from isi.home.home import Home
from tests.small_bundle import home_of
from tests.small_home import (
    KINDS,
    KNOWN,
    TRAINED,
    assert_same,
    quick_choices,
    seen,
)

NEW = [f"new {number}" for number in "abcdef"]
FIRST = KNOWN.entity_names[:8]
WHO = st.integers(0, 2)  #: One object, the other one, or the first in another thread.
INITIALIZERS = ["map", "rs", "iu", "xavier", "gaussian", "kind_mean"]
ABOUT = st.fixed_dictionaries(
    {},
    optional={"kind": st.sampled_from(KINDS), "initializer": st.sampled_from(INITIALIZERS)},
)
TIMES = [f"202{year}-01-01T00:00:00Z" for year in range(4)]
STAMP = st.fixed_dictionaries(
    {"time": st.sampled_from(TIMES), "source": st.sampled_from([None, "camera"])}
)
Stamp = dict[str, Any]
MOMENT, MONTH = datetime(2021, 7, 1, tzinfo=UTC), timedelta(days=30)
FUTURE = datetime(2999, 1, 1, tzinfo=UTC)


class Row(NamedTuple):
    """What is known of a fact: whether it holds, and the last fields of its ``StoredFact``."""

    holds: bool = True
    count: int = 1
    confidence: float | None = None
    first_seen: str | None = None
    last_seen: str | None = None
    source: str | None = None

    def seen(self, confidence: float | None, time: str, source: str | None) -> "Row":
        return Row(
            True,
            self.count + 1,
            self.confidence if confidence is None else confidence,
            min(self.first_seen or time, time),
            max(self.last_seen or time, time),
            source or self.source,
        )


class State(NamedTuple):
    """What was told about each inserted entity, and what is known of facts."""

    about: dict[str, dict[str, Any]]
    rows: dict[Fact, Row]

    @property
    def holding(self) -> set[Fact]:
        return {fact for fact, row in self.rows.items() if row.holds}

    def told(self, facts: set[Fact], stamp: Stamp, confidence: float | None = None) -> "State":
        unseen = Row(count=0)
        told = {fact: self.rows.get(fact, unseen).seen(confidence, **stamp) for fact in facts}
        return self._replace(rows=self.rows | told)

    def without(self, facts: set[Fact], entity: str = "") -> "State":
        """Facts of training are retracted, others are gone."""
        rows = {fact: row for fact, row in self.rows.items() if fact not in facts or fact in START}
        rows |= {fact: rows[fact]._replace(holds=False) for fact in facts & rows.keys()}
        return State({name: told for name, told in self.about.items() if name != entity}, rows)


START = dict.fromkeys(TRAINED, Row())


class HomeMachine(RuleBasedStateMachine):
    @initialize()
    def start(self) -> None:
        self.stack = ExitStack()
        self.stack.enter_context(quick_choices(of_known=True))
        self.folder = Path(self.stack.enter_context(tempfile.TemporaryDirectory())) / "home"
        self.thread = self.stack.enter_context(ThreadPoolExecutor(1))
        home_of(self.folder, KNOWN)
        self.lives = [isi.open(self.folder) for _ in range(2)]
        self.states = [State({}, START)]  # after each change that is in force
        self.changes = self.undone = 0

    def teardown(self) -> None:
        if not hasattr(self, "stack"):
            return
        with self.stack:
            for _ in self.states[1:]:
                self.lives[0].undo()
            self.states = self.states[:1]
            assert {row.fact for row in self.lives[1].facts()} == self.now.holding
            for home in self.lives:
                home.close()

    @property
    def now(self) -> State:
        return self.states[-1]

    def names(self, *new: str) -> st.SearchStrategy[str]:
        return st.sampled_from([*FIRST, *self.now.about, *new])

    def facts(self, data: st.DataObject, ends: Any, least: int = 0, most: int = 3) -> set[Fact]:
        """Random facts between the entities of a strategy."""
        fact = st.tuples(ends, st.sampled_from(KNOWN.relation_names), ends)
        return set(data.draw(st.lists(fact, min_size=least, max_size=most)))

    def do(self, who: int, verb: str, *given: Any, **about: Any) -> Effect:
        method = getattr(self.lives[who % 2], verb)
        if who == 2:
            return self.thread.submit(method, *given, **about).result()  # type: ignore[no-any-return]
        return method(*given, **about)  # type: ignore[no-any-return]

    def becomes(self, state: State, effect: Effect, stamp: Stamp | None = None) -> None:
        """A change has led to a state; one that changes nothing is not listed."""
        before = self.now
        assert effect.facts == len(state.holding - before.holding)
        assert set(effect.lost) == before.holding - state.holding
        assert set(effect.inserted) == state.about.keys() - before.about.keys()
        assert set(effect.removed) == before.about.keys() - state.about.keys()
        assert set(effect.updated) <= state.about.keys()
        if state != before:
            self.states.append(state)
            self.changes += 1
            last = self.lives[1].history()[-1]
            made = {"time": f"{last.time:%Y-%m-%dT%H:%M:%SZ}", "source": last.source}
            assert stamp in (None, made)

    @contextmanager
    def refused(self, because: bool) -> Iterator[None]:
        """What is inside may be refused ``because`` of something, and then it changes nothing."""
        before = seen(self.lives[1])
        try:
            yield
        except isi.InputError:
            assert because
            assert_same(seen(self.lives[1]), before)

    @rule(
        data=st.data(),
        who=WHO,
        refuse=st.booleans(),
        new=st.lists(st.sampled_from(NEW), max_size=2, unique=True),
        about=ABOUT,
        confidence=st.sampled_from([None, 0.25, 1.0]),
        stamp=STAMP,
    )
    def tell(
        self,
        data: st.DataObject,
        who: int,
        refuse: bool,
        new: list[str],
        about: dict[str, Any],
        confidence: float | None,
        stamp: Stamp,
    ) -> None:
        facts = self.facts(data, self.names(*new))
        facts |= {(name, "in", data.draw(self.names())) for name in new if data.draw(st.booleans())}
        ends = {end for head, _, tail in facts for end in (head, tail)}
        unknown = {*new, *ends} - self.now.about.keys() - {*KNOWN.entity_names}
        wrong = refuse and bool(unknown)
        state = self.now.told(facts, stamp, confidence)
        state = state._replace(about=state.about | dict.fromkeys(sorted(unknown), about))
        # without facts or words, and with facts between entities of different initializers
        risky = any("initializer" in told for told in state.about.values()) or not facts
        risky |= any(not any(name in fact for fact in facts) for name in unknown)
        options = {"confidence": confidence, "entities": new, **stamp, **about}
        options["new"] = "refuse" if refuse else "insert"
        with self.refused(wrong or risky):
            effect = self.do(who, "tell", sorted(facts), **options)
            assert not wrong
            assert effect.seen == len(facts & self.now.holding)
            self.becomes(state, effect, stamp)

    @rule(data=st.data(), who=WHO, named=st.booleans(), stamp=STAMP)
    def move(self, data: st.DataObject, who: int, named: bool, stamp: Stamp) -> None:
        ((head, label, tail),) = moved = self.facts(data, self.names(), 1, 1)
        tails = sorted(fact[2] for fact in self.now.holding if fact[:2] == (head, label))
        old = data.draw(st.sampled_from(tails)) if named and tails else None
        gone = {(head, label, each) for each in tails if old in (None, each)} - moved
        with self.refused(bool(gone)):  # of an entity that is left without a fact
            effect = self.do(who, "move", head, label, tail, instead_of=old, **stamp)
            self.becomes(self.now.without(gone).told(moved, stamp), effect, stamp)

    @rule(data=st.data(), who=WHO)
    def remove_an_entity(self, data: st.DataObject, who: int) -> None:
        name = data.draw(self.names())
        facts = {fact for fact in self.now.holding if name in (fact[0], fact[2])}
        with self.refused(name in FIRST or bool(facts)):
            effect = self.do(who, "remove", name)
            self.becomes(self.now.without(facts, name), effect)

    @rule(data=st.data(), who=WHO, wrong=st.booleans())
    def remove_a_fact(self, data: st.DataObject, who: int, wrong: bool) -> None:
        holding = sorted(self.now.holding)
        facts = self.facts(data, self.names(), 1, 1) if wrong else set[Fact]()
        facts = facts or {data.draw(st.sampled_from(holding))}
        (fact,) = facts
        with self.refused(not facts <= self.now.holding or fact not in START):
            effect = self.do(who, "remove", facts=[fact])
            answers = {best.entity for best in self.lives[1].ask(*fact[:2], top=99).answers}
            assert fact not in START or fact[2] not in answers
            self.becomes(self.now.without(facts), effect)

    @rule(who=WHO)
    def undo(self, who: int) -> None:
        with self.refused(len(self.states) == 1):
            self.do(who, "undo")
            self.states.pop()
            self.changes += 1
            self.undone += 1

    @rule(who=st.integers(0, 1))
    def train_again(self, who: int) -> None:
        """On the same vectors and triples: what was inserted is inserted again."""
        self.lives[who].train_again(KNOWN)
        self.states = [self.now]
        self.changes += 1

    @rule()
    def copy(self) -> None:
        """Into another folder, and into memory; a copy that is changed leaves the home as it is."""
        in_memory = isi.open(self.folder, durability="memory")
        with tempfile.TemporaryDirectory() as folder:
            in_memory.save(folder)
            with isi.open(folder) as saved:
                for each in (saved, in_memory):
                    assert_same(seen(each), seen(self.lives[0]))
                    each.tell([("a copy", "in", "e1")])

    @rule(who=st.integers(0, 1))
    def open_again(self, who: int) -> None:
        self.lives[who].close()
        self.lives[who] = isi.open(self.folder)

    @invariant()
    def all_follows_from_what_was_told(self) -> None:
        if not hasattr(self, "stack"):
            return
        expected = seen(self.at_once())
        rows = {fact: row[1:] for fact, row in self.now.rows.items() if row.holds}
        for home in self.lives:
            assert_same(seen(home), expected)
            assert {row.fact: astuple(row)[5:] for row in home.facts()} == rows
            now, known = home.now, len(KNOWN.entities)
            assert now.entities[:known].tobytes() == KNOWN.entities.tobytes()
            assert now.relations.tobytes() == KNOWN.relations.tobytes()
            assert now.entity_names == [*KNOWN.entity_names, *home.inserted]
            assert sorted(now.named_triples()) == sorted(rows)
            assert len(home.history()) == self.changes
            assert sum(change.undone for change in home.history()) == self.undone

    def check_stale(self, home: Home) -> None:
        """A fact that was not seen since training counts as seen then, which is now."""
        last = {fact: row.last_seen or "3" for fact, row in self.now.rows.items() if row.holds}
        stale = home.stale(MONTH, MOMENT)
        assert {row.fact for row in stale} == {fact for fact in last if last[fact] < "2021-06"}
        times = [row.last_seen or "3" for row in home.stale(MONTH, FUTURE)]
        assert times == sorted(last.values())

    def check_answers(self, home: Home) -> None:
        """Those without what is known, and those among some entities."""
        query = next(iter(home.inserted), "e0"), "in"
        every = home.ask(*query, top=99).answers
        new = home.ask(*query, top=99, new=True).answers
        assert [each.entity for each in new] == [each.entity for each in every if not each.known]
        some = home.ask(*query, among=["e9", "e1", "e9", "e4"]).answers
        expected = [each.entity for each in every if each.entity in ("e1", "e4", "e9")]
        assert [each.entity for each in some] == expected

    @invariant()
    def questions_agree(self) -> None:
        if hasattr(self, "stack"):
            self.check_stale(self.lives[1])
            self.check_answers(self.lives[1])

    def at_once(self) -> Home:
        """Another home, which is told what holds by one change for each initializer."""
        fresh, (about, rows) = Home(KNOWN), self.now
        told = {(*fact, row.confidence or 1.0) for fact, row in rows.items() if row.holds}
        for initializer in {about.get("initializer") for about in about.values()}:
            names = [name for name in about if about[name].get("initializer") == initializer][::-1]
            facts = {fact for fact in told if {fact[0], fact[2]} & {*names}}
            kinds = {name: about[name]["kind"] for name in names if "kind" in about[name]}
            fresh.tell(sorted(facts), entities=names, initializer=initializer, kind=kinds)
        fresh.tell(sorted(told, reverse=True))
        fresh.remove(facts=sorted(START.keys() - self.now.holding))
        return fresh


HomeMachine.TestCase.settings = settings(max_examples=20, stateful_step_count=12, deadline=None)
TestHome = HomeMachine.TestCase
