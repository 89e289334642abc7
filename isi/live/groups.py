"""Vectors of entities that are inserted into one bundle.
What does not change between calls is prepared once.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from isi.errors import InputError
from isi.insertion.api import insert_request
from isi.insertion.engine import Method
from isi.insertion.hidden import HoldOut
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.insertion.result import Inserted
from isi.insertion.selection import named, one_score, select
from isi.live.folder import EntityRecord
from isi.live.journal import Additions, NewEntity, Selected
from isi.live.loaded import Fact, LoadedEmbedding
from isi.live.phrases import PhraseVector, PhraseVectors
from isi.live.stored import StoredVector, digest_of, key_of
from isi.models.stack import usual_torch
from isi.names import plain

#: Numbers of facts for which an initializer is selected. That for the largest one serves entities
#: with more.
PREPARED = (0, 1, 2, 3, 5, 8)
#: Of the selection. With this tolerance, ten or twelve objects in a row lower the MRR of known
#: triples by at most 0.001 on AI2-THOR and on ``examples/home.csv``; with that of ``isi.insert``,
#: 0.02, by up to 0.024.
TOLERANCE, BUDGET = 0.013, 3.0
NO_WORDS = PhraseVector(None, "this embedding has no word vectors", None, None)


class Conditions(NamedTuple):
    """The conditions of an insertion: under equal ones, entities get the same initializer."""

    facts: int  #: mean number with known entities; one of ``PREPARED``
    words: bool  #: whether all have word vectors
    initializer: str | None  #: None: the one selected for so many facts
    options: tuple[tuple[str, Any], ...]
    seed: int


@dataclass(frozen=True, eq=False)
class NewName:
    """What is known of an entity before it is inserted."""

    about: NewEntity
    facts: list[Fact]  #: sorted
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: sentences on its kind, its words and unusual facts


@dataclass(frozen=True, eq=False)
class Group:
    """Entities that are inserted in one call, by name, sorted."""

    conditions: Conditions
    members: dict[str, NewName]
    share_facts: bool  #: whether the vector of one depends on the others

    @property
    def facts(self) -> list[Fact]:
        """The facts of all members, sorted."""
        return sorted({fact for member in self.members.values() for fact in member.facts})

    def part(self, names: Collection[str]) -> Group:
        """The group of some of its members."""
        return replace(self, members={name: self.members[name] for name in names})


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An inserted entity as it stands: its record, its vector, its words and its kind."""

    record: EntityRecord  #: its facts are sorted
    vector: np.ndarray  #: shape: (d,)
    key: str  #: of all inputs of the vector (``isi.live.stored``)
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: those of ``NewName``, and warnings of the selection
    conditions: Conditions


@dataclass(eq=False)
class EntityGroups:
    """Inserts entities into a bundle of known entities, each from its own facts and words, together
    with those that share facts with it.
    """

    base: LoadedEmbedding
    phrases: PhraseVectors | None
    #: by number of facts, and whether with words
    selected: dict[tuple[int, bool], Selected] = field(default_factory=dict)
    #: vectors that were computed before, by key
    stored: dict[str, StoredVector] = field(default_factory=dict)
    #: the last results of the engine, and the place of a row in them, by key
    _results: dict[str, tuple[Inserted, int]] = field(default_factory=dict)
    _curves: dict[Conditions, Curves | None] = field(default_factory=dict)

    @cached_property
    def _digest(self) -> str:
        """A digest of all that vectors depend on, except what is inserted."""
        base = self.base
        about = [
            base.manifest.model_name,
            base.manifest.model_options,
            base.kinds,
            base.entity_names,
        ]
        tables = base.entities, base.relations, base.triples, base.words
        return key_of(about, digest_of(*tables))

    def insert_groups(
        self, additions: Additions, names: Collection[str]
    ) -> dict[str, InsertedEntity]:
        """Insert the entities ``names``, and all that share facts with them, from all their facts.

        An ``InputError`` names an entity that has neither facts nor words nor an initializer of its
        own.
        """
        self._results.clear()
        rows, known_triples = dict[str, InsertedEntity](), self.known_triples(additions)
        for group in self._groups(additions, names):
            rows |= self._insert(group, additions, known_triples)
        return rows

    def result_of(self, row: InsertedEntity, additions: Additions) -> tuple[Inserted, int]:
        """The result of the engine that has the vector of a row, and its place there. A row whose
        vector was stored is computed again.
        """
        if row.key not in self._results:
            (group,) = self._groups(additions, [row.record.entity])
            method, _ = self._method(group.conditions)
            result = self._rows_of_group(group, method, self.known_triples(additions))
            self._results[row.key] = result, list(group.members).index(row.record.entity)
        return self._results[row.key]

    def members_with(self, name: str, additions: Additions) -> list[str]:
        """An inserted entity and those that a chain of facts joins to it, sorted."""
        return _together(name, additions.of_entity)

    def known_triples(self, additions: Additions) -> np.ndarray:
        """The triples of training that have not been retracted; ids, shape (T, 3)."""
        return self.base.triples_without(additions.retracted)

    def words(self, name: str, about: NewEntity) -> PhraseVector:
        """The word vector of a new entity, from its definition or its name."""
        if self.phrases is None:
            return NO_WORDS
        return self.phrases.vector(plain(name), about.definition)

    def _groups(self, additions: Additions, names: Collection[str]) -> list[Group]:
        """The groups of ``names`` and of all that share facts with them: entities that share facts
        are a group; all others under the same conditions are another.
        """
        members_of = dict[tuple[Any, ...], dict[str, NewName]]()
        grouped = set[str]()
        for name in additions.entities:
            if name not in names or name in grouped:
                continue
            together = _together(name, additions.of_entity)
            grouped.update(together)
            members = {each: self._member(each, additions) for each in together}
            conditions = _conditions(members, additions.entities.keys())
            key = (conditions, name) if len(together) > 1 else (conditions,)
            members_of.setdefault(key, {}).update(members)
        groups = []
        for (conditions, *shared), members in members_of.items():
            in_order = {name: members[name] for name in sorted(members)}
            groups.append(Group(conditions, in_order, share_facts=bool(shared)))
        return groups

    def _member(self, name: str, additions: Additions) -> NewName:
        about, facts = additions.entities[name], sorted(additions.of_entity[name])
        words = self.words(name, about)
        kind, reason = about.kind or "", ""
        if not about.kind:
            alike = None
            if self.phrases is not None and words.vector is not None:
                alike = self.phrases.alike(plain(name), about.definition)
            kind, reason = self.base.kind_of(name, facts, alike)
        no_words = f"{name} has no words: {words.note}" if words.vector is None else ""
        notes = [reason, no_words, *self.base.kind_notes(facts, name)]
        return NewName(about, facts, words, kind, tuple(filter(None, notes)))

    def _insert(
        self, group: Group, additions: Additions, known_triples: np.ndarray
    ) -> dict[str, InsertedEntity]:
        """The rows of a group: stored vectors, and computed ones where these lack."""
        conditions = group.conditions
        method, warnings = self._method(conditions)
        initializer, options = method.initializer.name, dict(method.options)
        keys = self._keys(group, method, additions)
        vectors = {name: self.stored[key] for name, key in keys.items() if key in self.stored}
        missing = [name for name in group.members if name not in vectors]
        if missing:
            part = group if group.share_facts else group.part(missing)
            result = self._rows_of_group(part, method, known_triples)
            for place, name in enumerate(part.members):
                self._results[keys[name]] = result, place
                vectors[name] = StoredVector(result.vectors[place].copy(), result.fallback[place])
        rows = dict[str, InsertedEntity]()
        for name, member in group.members.items():
            record = EntityRecord(
                entity=name,
                insert_triples=member.facts,
                definition=member.about.definition,
                requested_initializer=member.about.initializer,
                options=options,
                seed=member.about.seed,
                initializer=initializer,
                why=method.why,
                fallback=vectors[name].fallback,
            )
            rows[name] = InsertedEntity(
                record,
                vectors[name].vector,
                keys[name],
                member.words,
                member.kind,
                (*member.notes, *warnings),
                conditions,
            )
        return rows

    def _keys(self, group: Group, method: Method, additions: Additions) -> dict[str, str]:
        """The key of each member's vector: a digest of all that it depends on."""
        inputs = {}
        for name, member in group.members.items():
            inputs[name] = [name, member.facts, member.kind, digest_of(member.words.vector)]
        shared = [
            self._digest,
            method.initializer.name,
            dict(method.options),
            group.conditions.seed,
            sorted(additions.retracted),
        ]
        if method.trained_with != "logistic":
            shared.append(method.trained_with)
        keys = {}
        for name in group.members:
            keys[name] = key_of(shared, inputs if group.share_facts else inputs[name], name)
        return keys

    def _rows_of_group(self, group: Group, method: Method, known_triples: np.ndarray) -> Inserted:
        """Insert a group into the bundle's embedding."""
        base, members = self.base, list(group.members.values())
        ids = ChainMap(
            {name: row for row, name in enumerate(group.members, len(base.entities))},
            base.entity_ids,
        )
        triples = [
            (ids[head], base.relation_ids[relation], ids[tail])
            for head, relation, tail in group.facts
        ]
        known = KnownEmbedding(base.entities, base.relations, base.model, triples=known_triples)
        request = InsertRequest(
            triples=np.array(triples, np.int64).reshape(-1, 3),
            new=len(members),
            words=self._word_rows(members),
            kinds=self._kind_ids(members),
            initializer=method.initializer.name,
            options=method.options,
            loss=method.trained_with,
            seed=group.conditions.seed,
            entity_keys=np.array([crc32(name.encode()) for name in group.members], np.int64),
        )
        return insert_request(known, request)

    def _kind_ids(self, members: Sequence[NewName]) -> np.ndarray:
        """A number for the kind of each known entity and of new ones, (E + n,); -1 without one."""
        new = [self.base.kind_numbers.get(member.kind, -1) for member in members]
        return np.concatenate([self.base.kind_ids, np.array(new, np.int64)])

    def _word_rows(self, members: Sequence[NewName]) -> np.ndarray | None:
        """Word vectors of the known entities and of new ones, (E + n, v);
        None if no new one has words.
        """
        vectors, known = [member.words.vector for member in members], self.base.words
        if known is None or all(vector is None for vector in vectors):
            return None
        return with_rows(known, vectors)

    def _method(self, conditions: Conditions) -> tuple[Method, Sequence[str]]:
        """The initializer under some conditions, and warnings of its selection."""
        base, entities = self.base, len(self.base.entities)
        if conditions.initializer is not None:
            options = dict(conditions.options)
            method = named(conditions.initializer, options, base.model, entities)
            return replace(method, trained_with=base.manifest.trained_with or "logistic"), ()
        selected = self.selected_for(conditions.facts, conditions.words)
        method = named(selected.initializer, dict(selected.options), base.model, entities)
        method = replace(method, why=selected.why, trained_with=selected.trained_with)
        return method, selected.warnings

    def selected_for(self, number: int, words: bool) -> Selected:
        """The initializer for so many facts, selected on hidden known entities and then
        remembered.
        """
        if (number, words) not in self.selected:
            with usual_torch():
                method, selection = select(
                    self._hold_out(number, words),
                    number > 0,
                    words,
                    tolerance=TOLERANCE,
                    budget=BUDGET,
                )
            self.selected[number, words] = Selected(
                facts=number,
                words=words,
                initializer=method.initializer.name,
                options=dict(method.options),
                why=method.why,
                warnings=selection.warnings if selection else [],
                trained_with=method.trained_with,
            )
        return self.selected[number, words]

    def curves(self, row: InsertedEntity) -> Curves | None:
        """The curves that calibrate answers about an inserted entity;
        None with too few known triples.
        """
        return self._fit(row.conditions)

    def _fit(self, conditions: Conditions) -> Curves | None:
        """The curves under some conditions, fitted once."""
        any_seed = conditions._replace(seed=0)  # hidden entities do not depend on it
        if any_seed not in self._curves:
            method, _ = self._method(conditions)
            with usual_torch():
                test = self._hold_out(conditions.facts, conditions.words)
                draws = replace(test, loss=method.trained_with).hide()
                self._curves[any_seed] = None if draws is None else fit_curves(draws, method)
        return self._curves[any_seed]

    def _hold_out(self, number: int, words: bool) -> HoldOut:
        """The hold-out test with so many insert triples for each hidden entity."""
        base = self.base
        return HoldOut(
            replace(base.embedding, model=one_score(base.model)),
            base.triples,
            np.array([number]),
            base.words if words else None,
            base.kind_ids,
            seed=0,
            loss=base.manifest.trained_with,
        )

    def preparation(self) -> Iterator[Callable[[], object]]:
        """Steps that select initializers and fit curves for all numbers of facts;
        some take a second.
        """
        for number, words in product(PREPARED, [False] if self.phrases is None else [False, True]):
            yield partial(self.selected_for, number, words)
            yield partial(self._fit, Conditions(number, words, None, (), 0))


def _conditions(members: Mapping[str, NewName], inserted: Collection[str]) -> Conditions:
    """Under what conditions entities that share facts are inserted."""
    requests, known_facts = set(), 0
    for name, member in members.items():
        about = member.about
        requests.add((about.initializer, tuple(sorted(about.options.items())), about.seed))
        if not member.facts and member.words.vector is None and about.initializer is None:
            expected = f"expected a fact or a word vector; {member.words.note}"
            raise InputError(repr(name)[:80], "", expected)
        known_facts += sum(
            not (head in inserted and tail in inserted) for head, _, tail in member.facts
        )
    if len(requests) > 1:
        expected = (
            "expected one initializer, one set of options "
            "and one seed of entities that share a fact"
        )
        raise InputError(", ".join(members)[:80], "", expected)
    (request,) = requests
    all_have_words = all(member.words.vector is not None for member in members.values())
    return Conditions(prepared(known_facts / len(members)), all_have_words, *request)


def prepared(facts: float) -> int:
    """The number in ``PREPARED`` that serves so many facts."""
    return max(number for number in PREPARED if number <= facts)


def _together(name: str, facts: Mapping[str, Collection[Fact]]) -> list[str]:
    """An inserted entity and those that a chain of facts joins to it, sorted;
    ``facts``: those of each inserted entity.
    """
    reached, waiting = {name}, [name]
    while waiting:
        others = {
            end for head, _, tail in facts[waiting.pop()] for end in (head, tail)
        } & facts.keys() - reached
        reached |= others
        waiting += others
    return sorted(reached)


def with_rows(known: np.ndarray, vectors: Sequence[np.ndarray | None]) -> np.ndarray:
    """A table, (E, v), with a row for each of n vectors, zeros where there is none;
    shape (E + n, v).
    """
    added = np.zeros((len(vectors), known.shape[1]), known.dtype)
    for row, vector in zip(added, vectors, strict=True):
        if vector is not None:
            row[:] = vector
    return np.concatenate([known, added])
