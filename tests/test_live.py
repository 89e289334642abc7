"""Random sequences of changes: known rows stay,
and vectors and answers follow from the set of facts alone.
"""

import json
import resource
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)
from isi.live.folder import write

import isi
from isi.live.embedding import LiveEmbedding
from isi.live.groups import PREPARED
from tests.small_live import KINDS, KNOWN, assert_same, chosen, live_of, seen

NEW = [f"new {number}" for number in "abcdef"]
Fact = tuple[str, str, str]
State = tuple[dict[str, dict[str, Any]], set[Fact]]
TRAINED = frozenset(live_of().base.named_triples())
KNOWN_NAME, LABEL = st.sampled_from(KNOWN.entity_names[:8]), st.sampled_from(["in", "on"])
ABOUT = st.fixed_dictionaries(
    {},
    optional={
        "kind": st.sampled_from(KINDS),
        "initializer": st.sampled_from(["map", "rs", "iu"]),
        "new": st.just(True),
    },
)


class LiveMachine(RuleBasedStateMachine):
    """Changes a live embedding, and computes what follows from them in a second way, from sets."""

    inserted = Bundle("inserted")

    @initialize(journal=st.booleans())
    def start(self, journal: bool) -> None:
        self.home = tempfile.TemporaryDirectory()
        self.folder, self.journal, self.saved = Path(self.home.name) / "home", journal, 0
        write(self.folder, KNOWN)
        self.live = isi.open(self.folder, journal=True) if journal else live_of()
        #: about each inserted entity, and the facts that hold; after each change that is in force
        self.states: list[State] = [({}, set(TRAINED))]

    def teardown(self) -> None:
        if hasattr(self, "home"):
            self.live.close()
            self.home.cleanup()

    @property
    def about(self) -> dict[str, dict[str, Any]]:
        return self.states[-1][0]

    @property
    def holding(self) -> set[Fact]:
        return self.states[-1][1]

    @property
    def facts(self) -> set[Fact]:
        """The added facts."""
        return self.holding - TRAINED

    def becomes(self, about: dict[str, dict[str, Any]], holding: set[Fact]) -> None:
        self.states.append((about, holding))

    @contextmanager
    def refused_without_a_change(self) -> Iterator[list[bool]]:
        """Whether what is inside was refused; if it was, nothing has changed."""
        before, number, refused = seen(self.live), len(self.live.history), [False]
        try:
            yield refused
        except isi.InputError:
            refused[0] = True
            assert len(self.live.history) == number
            assert_same(seen(self.live), before)

    def name(self, data: st.DataObject) -> str:
        return data.draw(st.sampled_from([*KNOWN.entity_names[:8], *self.about]))

    @rule(data=st.data(), name=st.sampled_from(NEW), size=st.integers(0, 9), about=ABOUT)
    def insert(self, data: st.DataObject, name: str, size: int, about: dict[str, Any]) -> None:
        if name in self.about:
            with pytest.raises(isi.InputError):
                self.live.insert(name, [(name, "in", "e0")])
            return
        facts = set()
        for _ in range(size):
            ends = [name, self.name(data)][:: data.draw(st.sampled_from([1, -1]))]
            facts.add((ends[0], data.draw(LABEL), ends[1]))
        with self.refused_without_a_change() as refused:
            effect = self.live.insert(name, sorted(facts), **about)
            assert effect.inserted == [name]
        if not refused[0]:
            self.becomes({**self.about, name: about}, self.holding | facts)
        else:
            assert not facts or "initializer" in {
                key for each in [*self.about.values(), about] for key in each
            }

    @rule(data=st.data(), names=st.lists(st.sampled_from(NEW), min_size=2, max_size=3, unique=True))
    def insert_together(self, data: st.DataObject, names: list[str]) -> None:
        names = [name for name in names if name not in self.about]
        facts = {(name, data.draw(LABEL), data.draw(KNOWN_NAME)) for name in names}
        facts |= {(one, "on", other) for one, other in pairwise(names)}
        if names:
            self.live.insert(names, sorted(facts))
            self.becomes(self.about | {name: {} for name in names}, self.holding | facts)

    @rule(data=st.data(), number=st.integers(1, 3))
    def observe(self, data: st.DataObject, number: int) -> None:
        facts = {(self.name(data), data.draw(LABEL), self.name(data)) for _ in range(number)}
        added = facts - self.holding
        with self.refused_without_a_change() as refused:
            effect = self.live.observe(sorted(facts))
            assert effect.known == len(facts) - len(added)
            assert effect.facts == len(added)
            touched = {end for fact in added for end in (fact[0], fact[2])} & self.about.keys()
            assert touched <= set(effect.updated) <= self.about.keys()
        if not refused[0] and added:
            self.becomes(self.about, self.holding | added)

    @precondition(lambda self: self.about)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(list(self.about)))
        with self.refused_without_a_change() as refused:
            assert self.live.remove(name).removed == [name]
        if not refused[0]:
            about = {other: each for other, each in self.about.items() if other != name}
            self.becomes(about, {fact for fact in self.holding if name not in (fact[0], fact[2])})

    @rule(data=st.data(), trained=st.booleans())
    def remove_a_fact(self, data: st.DataObject, trained: bool) -> None:
        """One that was added, or one of training, which is retracted."""
        holding = self.holding & TRAINED if trained else self.facts
        if not holding:
            return
        fact = data.draw(st.sampled_from(sorted(holding)))
        with self.refused_without_a_change() as refused:
            effect = self.live.remove(facts=[fact])
            assert effect.lost == [fact]
            answers = self.live.ask(*fact[:2], top=99).answers
            assert fact[2] not in {answer.entity for answer in answers if answer.known}
            assert not trained or fact[2] not in {answer.entity for answer in answers}
        if not refused[0]:
            self.becomes(self.about, self.holding - {fact})

    @rule(data=st.data())
    def remove_what_does_not_hold(self, data: st.DataObject) -> None:
        fact = (self.name(data), data.draw(LABEL), self.name(data))
        if fact not in self.holding:
            with self.refused_without_a_change() as refused:
                self.live.remove(facts=[fact])
            assert refused[0]

    @rule(data=st.data())
    def observe_again_what_was_retracted(self, data: st.DataObject) -> None:
        if retracted := sorted(TRAINED - self.holding):
            fact = data.draw(st.sampled_from(retracted))
            assert self.live.observe([fact]).facts == 1
            self.becomes(self.about, self.holding | {fact})

    @rule(data=st.data(), named=st.booleans())
    def move(self, data: st.DataObject, named: bool) -> None:
        head, label, tail = self.name(data), data.draw(LABEL), self.name(data)
        tails = sorted(fact[2] for fact in self.holding if fact[:2] == (head, label))
        old = data.draw(st.sampled_from(tails)) if named and tails else None
        gone = {(head, label, each) for each in tails if old in (None, each)} - {
            (head, label, tail)
        }
        after = self.holding - gone | {(head, label, tail)}
        with self.refused_without_a_change() as refused:
            effect = self.live.move(head, label, tail, instead_of=old)
            assert set(effect.lost) == gone
            assert effect.facts == len(after - self.holding)
        if not refused[0] and after != self.holding:
            self.becomes(self.about, after)

    @rule(data=st.data(), names=st.lists(st.sampled_from(NEW), min_size=1, max_size=2, unique=True))
    def upsert(self, data: st.DataObject, names: list[str]) -> None:
        """Observe facts of entities of which some are not known yet."""
        facts = {(name, data.draw(LABEL), data.draw(KNOWN_NAME)) for name in names}
        unknown = [name for name in names if name not in self.about]
        with self.refused_without_a_change() as refused:
            effect = self.live.observe(sorted(facts), upsert=True)
            assert set(effect.inserted) == set(unknown)
        if not refused[0] and (unknown or facts - self.holding):
            self.becomes(self.about | {name: {} for name in unknown}, self.holding | facts)

    @rule(data=st.data(), name=st.sampled_from(NEW))
    def insert_what_may_be_known(self, data: st.DataObject, name: str) -> None:
        facts = {(name, data.draw(LABEL), data.draw(KNOWN_NAME))}
        with self.refused_without_a_change() as refused:
            self.live.insert(name, sorted(facts), upsert=True)
        if not refused[0] and (name not in self.about or facts - self.holding):
            self.becomes({name: {}} | self.about, self.holding | facts)

    @rule()
    def compact(self) -> None:
        """The state stays; what had no effect on it is forgotten,
        and ``undo`` reaches what is left.
        """
        before, about, holding = seen(self.live), self.about, self.holding
        if not self.journal:
            return
        self.live.compact()
        assert self.live.compact() == 0
        assert_same(seen(self.live), before)
        self.states = [({}, set(TRAINED))]
        for change in self.live.history:
            names = self.about.keys() | change.entities.keys()
            lost = change.facts if change.do == "remove" else change.replaced
            gained = [] if change.do == "remove" else change.facts
            self.becomes({name: about[name] for name in names}, self.holding - {*lost} | {*gained})
        assert self.about == about
        assert self.holding == holding
        self.live.close()
        self.live = isi.open(self.folder, journal=True)
        assert len(self.live.history) == len(self.states) - 1

    @precondition(lambda self: "for a moment" not in self.about)
    @rule(data=st.data())
    def insert_and_remove(self, data: st.DataObject) -> None:
        before, fact = seen(self.live), ("for a moment", data.draw(LABEL), data.draw(KNOWN_NAME))
        self.live.insert(fact[0], [fact])
        self.live.remove(fact[0])
        assert_same(seen(self.live), before)
        self.states += [(self.about | {fact[0]: {}}, self.holding | {fact}), self.states[-1]]

    @rule()
    def undo(self) -> None:
        if len(self.states) == 1:
            with pytest.raises(isi.InputError):
                self.live.undo()
        else:
            self.live.undo()
            self.states.pop()

    @rule()
    def save_and_open(self) -> None:
        if self.journal:
            self.live.close()
            self.live = isi.open(self.folder, journal=True)
        else:
            self.saved += 1
            folder = self.folder.with_name(f"saved {self.saved}")
            self.live.save(folder)
            assert_same(seen(isi.open(folder)), seen(self.live))
            self.live = isi.open(folder)

    @invariant()
    def known_entities_stay(self) -> None:
        if hasattr(self, "live"):
            now, known = self.live.now, len(KNOWN.entities)
            assert now.entities[:known].tobytes() == KNOWN.entities.tobytes()
            assert now.relations.tobytes() == KNOWN.relations.tobytes()
            assert now.entity_names[:known] == KNOWN.entity_names
            assert set(now.named_triples()) == self.holding
            assert len(now.triples) == len(self.holding)

    @invariant()
    def all_follows_from_the_set_of_facts(self) -> None:
        if hasattr(self, "live"):
            assert self.live.inserted.keys() == self.about.keys()
            assert self.live.additions.facts.keys() == self.facts
            assert self.live.additions.retracted.keys() == TRAINED - self.holding
            assert list(self.live.inserted) == self.live.now.entity_names[len(KNOWN.entities) :]
            assert_same(seen(self.live), seen(self.at_once()))

    def at_once(self) -> LiveEmbedding:
        """Another object, to which the same facts are given at once, in another order."""
        fresh = live_of()
        for initializer in (None, "map", "rs"):
            names = [
                name for name, each in self.about.items() if each.get("initializer") == initializer
            ][::-1]
            of_these = {fact for fact in self.facts if {fact[0], fact[2]} & set(names)}
            others = self.about.keys() - set(names) - fresh.inserted.keys()
            of_these = {fact for fact in of_these if not {fact[0], fact[2]} & others}
            if names:
                kinds = {
                    name: self.about[name]["kind"] for name in names if "kind" in self.about[name]
                }
                fresh.insert(
                    names,
                    sorted(of_these, reverse=True),
                    kind=kinds,
                    initializer=initializer,
                    new=True,
                )
        fresh.observe(sorted(self.facts, reverse=True))
        fresh.remove(facts=sorted(TRAINED - self.holding))
        return fresh


LiveMachine.TestCase.settings = settings(max_examples=25, stateful_step_count=12, deadline=None)
TestLive = LiveMachine.TestCase


def test_a_journal_that_is_opened_first_lists_the_insertions_of_the_bundle(tmp_path: Path) -> None:
    """A bundle that was written without a journal records its insertions in
    ``embedding.json`` alone.
    """
    made = live_of()
    made.insert("new a", [("new a", "in", "e1")])
    made.save(tmp_path / "home")
    (tmp_path / "home" / "journal.jsonl").unlink()
    for _ in range(2):
        with isi.open(tmp_path / "home", journal=True) as live:
            assert_same(seen(live), seen(made))
            assert len(live.history) == 1


def test_a_change_that_does_not_fit_on_the_disk_is_refused_and_leaves_no_line(
    tmp_path: Path,
) -> None:
    write(tmp_path / "home", KNOWN)
    journal = tmp_path / "home" / "journal.jsonl"
    largest, handler = (
        resource.getrlimit(resource.RLIMIT_FSIZE),
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN),
    )
    with isi.open(tmp_path / "home", journal=True) as live:
        live.insert("new a", [("new a", "in", "e1")])
        before, content = seen(live), journal.read_bytes()
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(content) + 20, largest[1]))
        try:
            for fact in ([("new a", "on", "e2")], [("new a", "on", "e3")]):
                with pytest.raises(isi.InputError):
                    live.observe(fact)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, largest)
            signal.signal(signal.SIGXFSZ, handler)
        assert_same(seen(live), before)
        assert journal.read_bytes() == content
        live.observe([("new a", "on", "e4")])
        after = seen(live)
    with isi.open(tmp_path / "home") as again:
        assert_same(seen(again), after)
        assert len(again.history) == 2


def test_choices_stand_in_the_journal_before_the_change_that_needs_them(tmp_path: Path) -> None:
    write(tmp_path / "home", KNOWN)
    with isi.open(tmp_path / "home", journal=True) as live:
        live.prepare()
        live.insert("new a", [("new a", "in", "e1")])
    lines = [
        json.loads(line)
        for line in (tmp_path / "home" / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    ]
    assert [line["do"] for line in lines] == ["choose"] * len(PREPARED) + ["insert"]
    assert list(isi.open(tmp_path / "home").groups.selected.values()) == chosen()


@pytest.mark.parametrize("journal", [False, True])
@pytest.mark.parametrize("changed", [False, True])
def test_choices_without_a_change_are_saved_once(
    tmp_path: Path, journal: bool, changed: bool
) -> None:
    write(tmp_path / "home", KNOWN)
    with isi.open(tmp_path / "home", journal=journal) as live:
        if changed:
            live.insert("new a", [("new a", "in", "e1")], initializer="mean")
            live.save()
        live.prepare()
        for _ in range(2):
            live.save()
        live.save(tmp_path / "copy")
    for folder in ("home", "copy"):
        lines = (tmp_path / folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        assert len(lines) == len(PREPARED) + changed
        again = isi.open(tmp_path / folder)
        assert list(again.groups.selected.values()) == chosen()
        assert list(again.inserted) == ["new a"] * changed


@pytest.mark.parametrize(
    "fact", [5, None, "e1 in e2", ("e1", "in"), {"e1": 1, "in": 2, "e2": 3}, ("e1", "in", 5)]
)
def test_what_is_no_fact_is_refused(fact: Any) -> None:
    with pytest.raises(isi.InputError):
        live_of().observe([fact])


def test_a_new_name_is_stored_in_one_form_and_found_in_any() -> None:
    live = live_of()
    composed, decomposed, hidden = "caf\u00e9 mug", "cafe\u0301 mug", "caf\u00e9\u200b\u00a0mug"
    live.insert(decomposed, [(decomposed, "in", "e1")])
    assert list(live.inserted) == [composed]
    for name in (composed, decomposed, hidden):
        assert live.observe([(name, "in", "e1")]).known == 1
        with pytest.raises(isi.InputError, match="known"):
            live.insert(name, [(name, "in", "e2")])
    assert live.remove(hidden).removed == [composed]


def test_an_explanation_is_of_the_vector_that_an_entity_has_among_others() -> None:
    live = live_of()
    live.insert(["mug", "tray"], [("mug", "on", "tray"), ("tray", "in", "e0"), ("mug", "in", "e1")])
    for name, row in live.inserted.items():
        result, place = live.groups.result_of(row, live.additions)
        assert result.names.number == len(KNOWN.entities) + 2, name
        np.testing.assert_array_equal(result.entities[result.known + place], row.vector)
        assert live.explain(name).indicators


@pytest.mark.parametrize("name", ["xavier", "iu", "gaussian", "class_noise"])
def test_random_vectors_follow_from_the_seed_and_the_name_in_any_order(name: str) -> None:
    about: dict[str, Any] = {"initializer": name, "seed": 3}
    together = live_of()
    together.insert(NEW[:3], [(new, "in", "e1") for new in NEW[:3]], **about)
    expected = {new: row.vector for new, row in together.inserted.items()}
    for one, other in pairwise(expected.values()):
        assert (one != other).all()
    for order in permutations(NEW[:3]):
        live = live_of()
        for new in order:
            live.insert(new, {"in": "e1"}, **about)
        for each in (live, live_of(live.changes)):  # and the journal again
            for new, row in each.inserted.items():
                np.testing.assert_array_equal(row.vector, expected[new])
    live.remove(NEW[0])
    np.testing.assert_array_equal(live.inserted[NEW[1]].vector, expected[NEW[1]])


def test_an_indicator_whose_fact_was_retracted_can_be_left_out() -> None:
    live = live_of()
    fact = live.base.named_triples()[0]
    live.insert("mug", [("mug", "in", fact[0])], initializer="neighbour_mean")
    live.remove(facts=[fact])
    left_out = {(one.left_out, one.what) for one in live.explain("mug").without}
    assert ("indicator", fact[0]) in left_out
