"""What is derived from the rows of a home's database, and how it follows a change of them."""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError
from isi.evaluation.platt import Curves
from isi.graph.graph import HEAD, TAIL
from isi.home.answers import Curve, fit_curve, state_of
from isi.home.bundle import Bundle, Fact
from isi.home.changes import Change, names_in
from isi.home.choices import Choices
from isi.home.database import Database
from isi.home.facts import StoredFact
from isi.home.folder import trained
from isi.home.inserted import InsertedEntity, NewEntity
from isi.home.loaded import LoadedEmbedding, Query
from isi.home.phrases import phrase_vectors, with_words
from isi.names import plain
from isi.vocabulary import Vocabulary

if TYPE_CHECKING:  # what inserts needs PyTorch, and questions do without
    from isi.home.groups import EntityGroups

#: What a ``Derived`` reads when it is first asked for, and again after each change.
OF_ROWS = ("known_triples", "now", "relations")


class Derived:
    """The embedding of a home as it is at one moment of its database.

    It does not change: what follows from a change is another object, so that one that stands for
    the time before is whole when the change fails.
    """

    def __init__(
        self, database: Database, base: LoadedEmbedding, choices: Choices | None = None
    ) -> None:
        """Derive everything from the tables; ``base``: their trained embedding."""
        self.database = database
        self.base = base  #: the trained entities, with the triples of training
        self.training = database.last_training()  #: that of ``base``
        self.choices = choices or Choices(base, database)
        self.rows = dict[str, InsertedEntity]()  #: inserted entities, in order
        self._known_curves = dict[tuple[int, int], Curve | None]()  # by relation and slot
        self._read(since=0)

    @cached_property
    def groups(self) -> EntityGroups:
        """What inserts entities."""
        from isi.home.groups import EntityGroups

        return EntityGroups(self.base, phrase_vectors(self.base), self.choices)

    # -- how it follows the database ---------------------------------------------------------------

    def current(self) -> Derived:
        """This, with what other processes have changed, in a time that grows with that."""
        if self.database.version() == self._version:
            return self
        is_trained = self.database.last_training() != self.training
        if is_trained or not self.database.lists(self.last_change):
            return Derived(self.database, with_own_words(trained(self.database)))
        return self.following()

    def following(self) -> Derived:
        """This, with what changes from the last known one on have written."""
        following = copy(self)
        following._read(since=self.last_change[0])
        return following

    def outdated(self) -> Derived:
        """This after a failure. What a transaction wrote that was rolled back is forgotten; what
        was written nevertheless is taken over by ``current``.
        """
        outdated = copy(self)
        outdated.choices.forget()
        outdated._forget(*OF_ROWS, "names")
        outdated._version = None
        return outdated

    def after(self, change: Change) -> tuple[Derived, dict[str, InsertedEntity]]:
        """What stands after a change whose effects are listed, and the entities whose vectors
        follow from it; they are written, too.
        """
        changed = [*change.added, *change.lost]
        state = self.following()
        if not (changed or change.inserted or change.removed or change.relations):
            vars(state).update({name: vars(self)[name] for name in OF_ROWS if name in vars(self)})
        inserted = set(self.database.inserted())
        touched = {*change.inserted, *names_in([*changed, *change.believed])}
        names = inserted if change.training else touched & inserted
        return state._with_vectors(change.id, names, {fact[1] for fact in changed})

    def with_all_inserted(self, change: int) -> Derived:
        """This, with vectors of all inserted entities computed and written, as a change's: they
        came while the home was trained again.
        """
        names = self.database.inserted()
        return self._with_vectors(change, names, self.database.new_relations())[0]

    def _with_vectors(
        self, change: int, names: Collection[str], relations: Collection[str]
    ) -> tuple[Derived, dict[str, InsertedEntity]]:
        """This, with vectors of inserted entities, and of those that share facts with them,
        computed and written as a change's, and what was computed. So are the rows of relations that
        are not trained and have facts of these, or are among ``relations``.
        """
        state, computed = self, dict[str, InsertedEntity]()
        if names:
            computed = self.groups.insert(self.members_of(names), self.known_triples)
            for entity in computed.values():
                entity.store(self.database, change)
            state = self.following()
        new = self.database.new_relations().keys()
        if not new or not (computed or new & set(relations)):
            return state, computed
        for relation in sorted(new):
            if facts := [row.fact for row in self.database.facts_of_relation(relation)]:
                vector = self.groups.relation_row(facts, state.now)
                self.database.put_relation_vector(relation, vector.tobytes())
        return state.following(), computed

    def _read(self, since: int) -> None:
        """Read the vectors of changes from one on; what else the tables say, when it is needed."""
        rows = dict(self.rows)
        for row in self.database.vectors_since(since):
            entity = InsertedEntity.of_row(row, self.base.entities.dtype)
            rows[entity.entity] = entity
        present = [name for name in self.database.inserted() if name in rows]
        self._forget(*OF_ROWS, *(["names"] if present != list(self.rows) else []))
        self.rows = {name: rows[name] for name in present}
        self.last_change = self.database.last_change()
        self._version: int | None = self.database.version()

    def _forget(self, *names: str) -> None:
        for name in names:
            vars(self).pop(name, None)

    def members_of(self, names: Collection[str]) -> dict[str, NewEntity]:
        """Inserted entities, and all that a chain of facts joins to them, as they are to be
        inserted.
        """
        of_training, inserted = self.base.labels.ids, set(self.database.inserted())
        members: dict[str, NewEntity] = {}
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

    # -- the embedding -----------------------------------------------------------------------------

    @cached_property
    def known_triples(self) -> np.ndarray:
        """The triples of training that hold; ids, shape (T, 3)."""
        return self.base.triples_without(self.database.facts_with("retracted"))

    @cached_property
    def now(self) -> LoadedEmbedding:
        """The bundle with all inserted entities in its last rows, and all facts that hold."""
        return self.with_inserted(self.rows)

    def with_inserted(self, names: Collection[str]) -> LoadedEmbedding:
        """The bundle with some inserted entities in its last rows, and all facts that hold of
        these.
        """
        base, rows = self.base, [self.rows[name] for name in names]
        relations = {
            name: np.frombuffer(vector, base.relations.dtype)[None]
            for name, vector in self.database.new_relations().items()
            if vector is not None  # it has no facts yet
        }
        larger = replace(
            base,
            entities=np.concatenate([base.entities, *(row.vector[None] for row in rows)]),
            relations=np.concatenate([base.relations, *relations.values()]),
            entity_names=[*base.entity_names, *names],
            relation_names=[*base.relation_names, *relations],
            kinds=[*base.kinds, *(row.kind for row in rows)],
            phrases=[*base.phrases, *map(plain, names)],
            # those of inserted entities are looked up where they are needed
            words=None if base.words is None else np.pad(base.words, ((0, len(rows)), (0, 0))),
            inserted=len(rows),
            counts=None,
        )
        added, retracted = (
            larger.ids_of(filter(larger.has_names_of, self.database.facts_with(status)))
            for status in ("added", "retracted")
        )
        triples = np.concatenate([self.known_triples, added])
        return replace(
            larger,
            triples=triples,
            added=len(added),
            retracted=retracted,
            beliefs=larger.beliefs_of(self.database.doubtful_facts()),
        )

    def curve(self, entity: int, relation: int, slot: int) -> Curve | None:
        """What turns scores of answers to a query about an entity into probabilities."""
        manifest = self.base.manifest
        if entity < len(self.base.entities):
            if relation >= len(self.base.relations):
                return None
            stored = manifest.curves
            if stored is None:
                return self._curve_of_known(relation, slot)
        else:
            choice = self.choices.find(self.rows[self.now.entity_names[entity]].key)
            if choice is not None and choice.curves is not None:
                return choice.curves.of(relation)
            stored = manifest.inserted_curves
            if choice is None or stored is None:
                return None
        answers = self.now.answers(Query(entity, relation, slot))
        number = int((self.now.triples[:, [HEAD, TAIL]] == entity).sum())
        return Curves.of_stored(stored[state_of(number, bool(answers))]).of(relation)

    def _curve_of_known(self, relation: int, slot: int) -> Curve | None:
        """The curve of an embedding that was not trained here, from known triples."""
        if (relation, slot) not in self._known_curves:
            self._known_curves[relation, slot] = fit_curve(self.base, relation, slot)
        return self._known_curves[relation, slot]

    # -- names -------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> Vocabulary:
        """Of known and inserted entities."""
        return self.base.names.with_new(self.rows, "entities")

    @cached_property
    def relations(self) -> Vocabulary:
        """Of relations, new ones included."""
        return Vocabulary("relation", self.database.relations())

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
