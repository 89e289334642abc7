"""What is derived from the rows of a home's database, and how it follows a change of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError
from isi.home.answers import Curve, fit_curve
from isi.home.bundle import Bundle, Fact
from isi.home.changes import Change, names_in
from isi.home.choices import Choices
from isi.home.database import Database
from isi.home.facts import StoredFact
from isi.home.folder import trained
from isi.home.inserted import InsertedEntity
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import phrase_vectors, with_words
from isi.home.times import as_text
from isi.names import plain
from isi.vocabulary import Vocabulary

if TYPE_CHECKING:  # what inserts needs PyTorch, and questions do without
    from isi.home.groups import EntityGroups, Member


class Derived:
    """The embedding of a home as it is at one moment of its database.

    It does not change: what follows from a change is another object, so that one that stands for
    the time before is whole when the change fails. What is not always needed (``now``, names of
    relations, ...) is derived when it is first asked for.
    """

    def __init__(
        self, database: Database, base: LoadedEmbedding, choices: Choices | None = None
    ) -> None:
        """Derive everything from the tables; ``base``: their trained embedding."""
        self.database = database
        self.base = base  #: the trained entities, with the triples of training
        self.training = database.last_training()  #: that of ``base``
        self.choices = choices or Choices(base, database)
        self.last_change = database.last_change()
        self.rows = dict[str, InsertedEntity]()  #: inserted entities, in order
        self._known_curves = dict[tuple[int, int], Curve | None]()  # by relation and slot
        self._read_rows(0)
        self._version: int | None = database.version()

    @cached_property
    def groups(self) -> EntityGroups:
        """What inserts entities."""
        from isi.home.groups import EntityGroups

        return EntityGroups(self.base, phrase_vectors(self.base), self.choices)

    # -- how it follows the database ---------------------------------------------------------------

    def current(self) -> Derived:
        """This, with what other processes have changed, in a time that grows with that."""
        version = self.database.version()
        if version == self._version:
            return self
        is_trained = self.database.last_training() != self.training
        if is_trained or not self.database.lists(self.last_change):
            return Derived(self.database, with_own_words(trained(self.database)))
        current = copy(self)
        last_change = self.database.last_change()
        if last_change != self.last_change:
            current._read_rows(self.last_change[0])
            current.last_change = last_change
        current._version = version
        return current

    def outdated(self) -> Derived:
        """This after a failure. What a transaction wrote that was rolled back is forgotten; what
        was written nevertheless is taken over by ``current``.
        """
        outdated = copy(self)
        outdated.choices.forget()
        outdated._forget()
        outdated._version = None
        return outdated

    def after(self, change: Change) -> tuple[Derived, dict[str, InsertedEntity]]:
        """What stands after a change whose effects are listed, and the entities whose vectors
        follow from it; they are written, too.
        """
        after = copy(self)
        if change.training:
            after._known_triples = None
        computed = after._computed(change)
        after._write(change.id, computed, [*change.added, *change.lost])
        has_names = bool(change.inserted or change.removed)
        present = self.database.inserted() if has_names else list(self.rows)
        rows = self.rows | computed
        after.rows = {name: rows[name] for name in present}
        after.last_change = change.id, change.verb, as_text(change.time), change.source
        if has_names or change.relations or change.verb == "undo":
            after._forget()
        elif computed or change.added or change.lost:
            after._now = None
        return after, computed

    def with_all_inserted(self, change: int) -> Derived:
        """This, with vectors of all inserted entities computed and written, as a change's: they
        came while the home was trained again.
        """
        names = self.database.inserted()
        if not names:
            return self
        after = copy(self)
        computed = after.groups.insert(after.members_of(names), after.known_triples)
        after.rows = {name: computed[name] for name in names}
        after._write(change, computed, self.database.facts_with("added"))
        return after

    def _read_rows(self, after: int) -> None:
        """Read the vectors of changes after one."""
        rows = dict(self.rows)
        for row in self.database.vectors_after(after):
            entity = InsertedEntity.of_row(row, self.base.entities.dtype)
            rows[entity.entity] = entity
        present = self.database.inserted()
        self.rows = {name: rows[name] for name in present if name in rows}
        self._forget()

    def _forget(self) -> None:
        """Derive again, when it is needed, what the tables say."""
        self._now: LoadedEmbedding | None = None
        self._known_triples: np.ndarray | None = None
        self._known_names: Vocabulary | None = None
        self._known_relations: Vocabulary | None = None

    def _computed(self, change: Change) -> dict[str, InsertedEntity]:
        """The inserted entities whose vectors follow from a change, with those that share facts
        with them.
        """
        inserted = (self.rows.keys() | set(change.inserted)) - set(change.removed)
        touched = {*change.inserted, *names_in([*change.added, *change.lost, *change.believed])}
        if change.training:
            touched = inserted
        if names := touched & inserted:
            return self.groups.insert(self.members_of(names), self.known_triples)
        return {}

    def members_of(self, names: Collection[str]) -> dict[str, Member]:
        """Inserted entities, and all that a chain of facts joins to them, as they are to be
        inserted.
        """
        of_training, inserted = self.base.labels.ids, set(self.database.inserted())
        members: dict[str, Member] = {}
        waiting = sorted(names)
        while waiting:
            name = waiting.pop()
            if name in members:
                continue
            rows = [row for row in self.database.facts_of(name) if row.relation in of_training]
            facts = {row.fact: row.confidence or 1.0 for row in sorted(rows, key=_fact_of)}
            members[name] = self.groups.member(name, self.database.about(name), facts)
            waiting += [end for end in names_in(facts) if end in inserted and end not in members]
        return members

    def _write(
        self, change: int, computed: Mapping[str, InsertedEntity], changed: Iterable[Fact]
    ) -> None:
        """Write computed vectors, and the rows of the relations that are not trained and that these
        vectors, or facts that came or went, determine.
        """
        for entity in computed.values():
            entity.store(self.database, change)
        relations = self.database.new_relations().keys()
        if not relations or not (computed or relations & {fact[1] for fact in changed}):
            return
        rows = {**self.rows, **computed}
        present = self._as_it_is({name: rows[name] for name in self.database.inserted()})
        for relation in sorted(relations):
            if facts := [row.fact for row in self.database.facts_of_relation(relation)]:
                vector = self.groups.relation_row(facts, present)
                self.database.put_relation_vector(relation, vector.tobytes())

    # -- the embedding -----------------------------------------------------------------------------

    @property
    def known_triples(self) -> np.ndarray:
        """The triples of training that hold; ids, shape (T, 3)."""
        if self._known_triples is None:
            retracted = self.database.facts_with("retracted")
            self._known_triples = self.base.triples_without(retracted)
        return self._known_triples

    @property
    def now(self) -> LoadedEmbedding:
        """The bundle with all inserted entities in its last rows, and all facts that hold."""
        if self._now is None:
            self._now = self._as_it_is(self.rows)
        return self._now

    def _as_it_is(self, rows: Mapping[str, InsertedEntity]) -> LoadedEmbedding:
        """The bundle with inserted entities, and what the tables say holds."""
        base = self.base
        vectors = {
            name: np.frombuffer(vector, base.relations.dtype)[None]
            for name, vector in self.database.new_relations().items()
            if vector is not None
        }
        larger = replace(
            base,
            entities=np.concatenate([base.entities, *(row.vector[None] for row in rows.values())]),
            relations=np.concatenate([base.relations, *vectors.values()]),
            entity_names=[*base.entity_names, *rows],
            relation_names=[*base.relation_names, *vectors],
            kinds=[*base.kinds, *(row.kind for row in rows.values())],
            phrases=[*base.phrases, *map(plain, rows)],
            # those of inserted entities are looked up where they are needed
            words=None if base.words is None else np.pad(base.words, ((0, len(rows)), (0, 0))),
            inserted=len(rows),
            counts=None,
        )
        labels = larger.labels.ids  # a new relation has no vector before its first facts
        added, retracted = (
            larger.ids_of([fact for fact in self.database.facts_with(status) if fact[1] in labels])
            for status in ("added", "retracted")
        )
        triples = np.concatenate([self.known_triples, added])
        return replace(larger, triples=triples, added=len(added), retracted=retracted)

    def curve(self, entity: int, relation: int, slot: int) -> Curve | None:
        """What turns scores of answers to a query about an entity into probabilities."""
        if entity < len(self.base.entities):
            if relation >= len(self.base.relations):
                return None
            if (relation, slot) not in self._known_curves:
                self._known_curves[relation, slot] = fit_curve(self.base, relation, slot)
            return self._known_curves[relation, slot]
        row = self.rows[self.now.entity_names[entity]]
        choice = self.choices.find(row.key)
        return None if choice is None or choice.curves is None else choice.curves.of(relation)

    # -- names -------------------------------------------------------------------------------------

    @property
    def names(self) -> Vocabulary:
        """Of known and inserted entities."""
        if self._known_names is None:
            self._known_names = self.base.names.with_new(self.rows, "entities")
        return self._known_names

    @property
    def relations(self) -> Vocabulary:
        """Of relations, new ones included."""
        if self._known_relations is None:
            self._known_relations = Vocabulary("relation", self.database.relations())
        return self._known_relations

    def inserted(self, name: str) -> str:
        """The name of an inserted entity; InputError for another one."""
        if name not in self.rows:
            there = ", ".join(self.rows)[:120] or "none"
            expected = f"expected an entity that was inserted ({there}): known ones stay"
            raise InputError(repr(name)[:80], "", expected)
        return name


def with_own_words(bundle: Bundle) -> LoadedEmbedding:
    """The embedding of a home, with words that can be had here; one without was found to have
    none.
    """
    loaded = LoadedEmbedding(**vars(bundle))
    return loaded if loaded.words is None else with_words(loaded)


def _fact_of(row: StoredFact) -> Fact:
    return row.fact
