"""Vectors of entities that are inserted into one bundle, and the choices behind them: for each
number of facts, an initializer and the curves of its probabilities.
"""

from __future__ import annotations

import json
from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import torch

from isi.errors import InputError
from isi.evaluation.platt import PlattCurve
from isi.graph.vocabulary import ids_by_name
from isi.home.bundle import Fact, NewEntity
from isi.home.database import Database
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import PhraseVector, PhraseVectors
from isi.initializers.scale import fit_scale
from isi.insertion.api import insert_request
from isi.insertion.hidden import HoldOut
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.relations import fit_relations
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.insertion.result import Details
from isi.insertion.selection import named, one_score, select
from isi.models.losses import Loss, loss_named
from isi.models.stack import usual_torch
from isi.names import plain

#: Numbers of facts for which an initializer is selected. That for the largest one serves entities
#: with more.
PREPARED = (0, 1, 2, 3, 5, 8)
#: Of the selection: a home gets many entities, one after another.
HARM = 0.005
NO_WORDS = PhraseVector(None, "this embedding has no word vectors", None, None)


class Conditions(NamedTuple):
    """The conditions of an insertion: under equal ones, entities get the same initializer."""

    facts: int  #: mean number with known entities; one of ``PREPARED``
    words: bool  #: whether all have word vectors
    initializer: str | None  #: None: the one selected for so many facts
    options: tuple[tuple[str, Any], ...]
    seed: int

    @property
    def requested(self) -> str:
        """The initializer that was asked for, with its options; empty for none."""
        return "" if self.initializer is None else json.dumps([self.initializer, *self.options])


@dataclass(frozen=True)
class Choice:
    """What serves entities under some conditions, as tested on hidden known ones."""

    initializer: str
    options: Mapping[str, Any]
    why: str
    trained_with: Loss  #: that of training, or the one that is assumed
    warnings: Sequence[str]
    curves: Curves | None  #: None: there are too few known triples


@dataclass(frozen=True, eq=False)
class EntityInput:
    """What is given about an entity that is to be inserted."""

    about: NewEntity
    facts: Mapping[Fact, float]  #: by relations of training, sorted, and how far each is believed


@dataclass(frozen=True, eq=False)
class Member:
    """An entity before it is inserted."""

    given: EntityInput
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: sentences on its kind, its words and unusual facts


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An inserted entity as it stands."""

    entity: str
    vector: np.ndarray  #: shape: (d,)
    kind: str
    initializer: str
    options: Mapping[str, Any]
    why: str  #: the reason for this initializer
    fallback: str | None  #: the rule that replaced it for lack of data, or None
    notes: tuple[str, ...]
    conditions: Conditions

    def store(self, database: Database, change: int) -> None:
        """Write it into a home, as a change's."""
        values = {
            "entity": self.entity,
            "change": change,
            "initializer": self.initializer,
            "options": json.dumps(dict(self.options)),
            "why": self.why,
            "fallback": self.fallback,
            "kind": self.kind,
            "notes": json.dumps(self.notes),
            "facts": self.conditions.facts,
            "words": self.conditions.words,
            "vector": self.vector.tobytes(),
        }
        database.put_vector(values)


def stored(database: Database, after: int, dtype: np.dtype[Any]) -> dict[str, InsertedEntity]:
    """The inserted entities whose vectors changes after one have written; ``dtype``: of vectors."""
    query = (
        "SELECT entity, vector, vector.kind, vector.initializer, vector.options, why, fallback,"
        " notes, facts, words, entity.initializer, entity.options, seed"
        " FROM vector JOIN entity ON entity.name = vector.entity WHERE change > ?"
    )
    rows = dict[str, InsertedEntity]()
    for name, vector, kind, initializer, options, why, fallback, notes, *about in database.read(
        query, after
    ):
        number, words, requested, asked, seed = about
        requested_options = tuple(sorted(json.loads(asked).items()))
        rows[name] = InsertedEntity(
            entity=name,
            vector=np.frombuffer(vector, dtype),
            kind=kind,
            initializer=initializer,
            options=json.loads(options),
            why=why,
            fallback=fallback,
            notes=tuple(json.loads(notes)),
            conditions=Conditions(number, bool(words), requested, requested_options, seed),
        )
    return rows


class Computed(NamedTuple):
    """An inserted entity, the result of the engine that has its vector, and its place there."""

    entity: InsertedEntity
    result: Details
    place: int


@dataclass(eq=False)
class EntityGroups:
    """Inserts entities into a bundle of known entities, each from its own facts and words, together
    with those that share facts with it.
    """

    base: LoadedEmbedding
    phrases: PhraseVectors | None
    database: Database  #: where choices are stored
    _choices: dict[tuple[int, bool, str], Choice] = field(default_factory=dict)
    _warnings: list[str] = field(default_factory=list)  #: of choices that were made now

    def insert(
        self,
        given: Mapping[str, EntityInput],
        known_triples: np.ndarray,
        choice: Choice | None = None,
    ) -> dict[str, Computed]:
        """Insert entities, each with all that share facts with it.

        ``known_triples``: those of training that hold; ids, (T, 3). ``choice``: what serves all of
        them, else what serves each. An ``InputError`` names an entity that has neither facts nor
        words nor an initializer of its own.
        """
        members = {name: self._member(name, given[name]) for name in sorted(given)}
        groups = dict[tuple[Any, ...], dict[str, Member]]()
        for names in components(given):
            together = {name: members[name] for name in names}
            conditions = _conditions(together, members.keys())
            alone = names[0] if len(names) > 1 else ""
            groups.setdefault((conditions, alone), {}).update(together)
        computed = dict[str, Computed]()
        for (conditions, _), together in groups.items():
            serving = choice or self.choice(conditions)
            computed |= self._insert(conditions, serving, together, known_triples)
        return computed

    def words(self, name: str, definition: str | None) -> PhraseVector:
        """The word vector of a new entity, from its definition or its name."""
        if self.phrases is None:
            return NO_WORDS
        return self.phrases.vector(plain(name), definition)

    def _member(self, name: str, given: EntityInput) -> Member:
        about = given.about
        words = self.words(name, about.definition)
        kind, reason = about.kind or "", ""
        if not about.kind:
            alike = None
            if self.phrases is not None and words.vector is not None:
                alike = self.phrases.alike(plain(name), about.definition)
            kind, reason = self.base.kind_of(name, given.facts, alike)
        no_words = f"{name} has no words: {words.note}" if words.vector is None else ""
        notes = [reason, no_words, *self.base.kind_notes(given.facts, name)]
        return Member(given, words, kind, tuple(filter(None, notes)))

    def _insert(
        self,
        conditions: Conditions,
        choice: Choice,
        members: Mapping[str, Member],
        known_triples: np.ndarray,
    ) -> dict[str, Computed]:
        """Insert the entities of a group, sorted by name, into the bundle's embedding."""
        base = self.base
        new = {name: row for row, name in enumerate(members, len(base.entities))}
        ids = ChainMap(new, base.names.ids)
        facts = dict[Fact, float]()
        for member in members.values():
            facts |= member.given.facts
        facts = {fact: facts[fact] for fact in sorted(facts)}
        doubtful = any(believed < 1 for believed in facts.values())
        request = InsertRequest(
            triples=ids_by_name(facts, ids, base.labels.ids),
            new=len(members),
            words=self._word_rows([member.words.vector for member in members.values()]),
            kinds=self._kind_ids([member.kind for member in members.values()]),
            initializer=choice.initializer,
            options=choice.options,
            trained_with=base.manifest.loss or choice.trained_with,
            seed=conditions.seed,
            entity_keys=np.array([crc32(name.encode()) for name in members], np.int64),
            confidence=list(facts.values()) if doubtful else None,
        )
        known = KnownEmbedding(base.entities, base.relations, base.model, triples=known_triples)
        result = insert_request(known, request).details
        computed = dict[str, Computed]()
        for place, (name, member) in enumerate(members.items()):
            entity = InsertedEntity(
                entity=name,
                vector=result.vectors[place].copy(),
                kind=member.kind,
                initializer=choice.initializer,
                options=choice.options,
                why=choice.why,
                fallback=result.fallback[place],
                notes=member.notes,
                conditions=conditions,
            )
            computed[name] = Computed(entity, result, place)
        return computed

    def _kind_ids(self, kinds: Sequence[str]) -> np.ndarray:
        """A number for the kind of each known entity and of new ones, (E + n,); -1 without one."""
        new = [self.base.kind_numbers.get(kind, -1) for kind in kinds]
        return np.concatenate([self.base.kind_ids, np.array(new, np.int64)])

    def _word_rows(self, vectors: Sequence[np.ndarray | None]) -> np.ndarray | None:
        """Word vectors of the known entities and of new ones, (E + n, v);
        None if no new one has words.
        """
        known = self.base.words
        if known is None or all(vector is None for vector in vectors):
            return None
        missing = np.zeros(known.shape[1], known.dtype)
        new = [missing if vector is None else vector for vector in vectors]
        return np.concatenate([known, np.array(new, known.dtype)])

    # -- relations ---------------------------------------------------------------------------------

    def relation_row(self, facts: Sequence[Fact], now: LoadedEmbedding) -> np.ndarray:
        """The row of a relation that was not trained, from its facts between entities of ``now``;
        shape (w,).
        """
        base, number, ids = self.base, len(self.base.relations), now.names.ids
        known_triples = torch.from_numpy(base.triples)
        triples = torch.tensor([(ids[head], number, ids[tail]) for head, _, tail in facts])
        known = base.embedding.relation
        theta = replace(
            now.embedding, relation=torch.cat([known, torch.zeros_like(known[:, :1])], 1)
        )
        scale = fit_scale(base.embedding, known_triples, base.manifest.loss or "logistic")
        fitted = fit_relations(
            theta, len(base.entities), number, triples, known_triples, scale=scale
        )
        row: np.ndarray = fitted[0].numpy().astype(base.relations.dtype)
        return row

    # -- choices -----------------------------------------------------------------------------------

    def choice(self, conditions: Conditions) -> Choice:
        """What serves under some conditions: stored, or tested on hidden known entities now, which
        takes some seconds, and then stored.
        """
        key = conditions.facts, conditions.words, conditions.requested
        if key not in self._choices:
            self._choices[key] = self._stored(key) or self._store(key, self._choose(conditions))
        return self._choices[key]

    def is_chosen(self, conditions: Conditions) -> bool:
        """Whether the choice under some conditions is made already."""
        key = conditions.facts, conditions.words, conditions.requested
        return key in self._choices or self._stored(key) is not None

    def forget(self) -> None:
        """Read choices again: the transaction that stored some may have been rolled back."""
        self._choices.clear()

    def warnings(self) -> list[str]:
        """The warnings of choices that were made since the last call."""
        said, self._warnings = self._warnings, []
        return said

    def preparation(self) -> list[Conditions]:
        """The conditions for which a choice is still to be made: all numbers of facts, with words
        if there are any (for a name without words, the choice is made when it comes).
        """
        words = self.phrases is not None
        every = [Conditions(number, words, None, (), 0) for number in PREPARED]
        return [conditions for conditions in every if not self.is_chosen(conditions)]

    def _choose(self, conditions: Conditions) -> Choice:
        base, entities = self.base, len(self.base.entities)
        number, words, warnings = conditions.facts, conditions.words, list[str]()
        with usual_torch():
            test = self._hold_out(number, words)
            selection = None
            if conditions.initializer is None:
                method, selection = select(test, number > 0, words, harm=HARM)
                warnings = list(selection.warnings) if selection else []
                self._warnings += warnings
            else:
                options = dict(conditions.options)
                method = named(conditions.initializer, options, base.model, entities)
                method = replace(method, trained_with=base.manifest.loss or "logistic")
            draws = replace(test, loss=method.trained_with).hide()
            curves = None if draws is None else fit_curves(draws, method)
        return Choice(
            method.initializer.name,
            dict(method.options),
            method.why,
            loss_named(method.trained_with).name,
            warnings,
            curves,
        )

    def _stored(self, key: tuple[int, bool, str]) -> Choice | None:
        query = (
            "SELECT initializer, options, why, trained_with, warnings, curves FROM choice"
            " WHERE facts = ? AND words = ? AND requested = ?"
        )
        rows = self.database.read(query, *key)
        if not rows:
            return None
        initializer, options, why, trained_with, warnings, curves = rows[0]
        options, warnings = json.loads(options), json.loads(warnings)
        return Choice(initializer, options, why, trained_with, warnings, _curves_of(curves))

    def _store(self, key: tuple[int, bool, str], choice: Choice) -> Choice:
        values = (
            *key,
            choice.initializer,
            json.dumps(choice.options),
            choice.why,
            choice.trained_with,
            json.dumps(list(choice.warnings)),
            _text_of(choice.curves),
        )
        if self.database.is_read_only:
            return choice
        with self.database.transaction():
            if (
                self.database.last_training() == self.database.read_training
            ):  # else it is of another home
                self.database.read(
                    "REPLACE INTO choice VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", *values
                )
        return choice

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
            loss=base.manifest.loss,
        )


def _text_of(curves: Curves | None) -> str | None:
    """Curves as JSON: slope and offset of all relations, and of each that has its own."""
    if curves is None:
        return None
    each = {
        str(relation): list(vars(curve).values()) for relation, curve in curves.of_relation.items()
    }
    return json.dumps({"all": list(vars(curves.of_all).values()), **each})


def _curves_of(text: str | None) -> Curves | None:
    if text is None:
        return None
    curves = {key: PlattCurve(*values) for key, values in json.loads(text).items()}
    of_all = curves.pop("all")
    return Curves({int(relation): curve for relation, curve in curves.items()}, of_all)


def _conditions(members: Mapping[str, Member], inserted: Collection[str]) -> Conditions:
    """Under what conditions entities that share facts are inserted."""
    requests, known_facts = set(), 0
    for name, member in members.items():
        about, facts = member.given.about, member.given.facts
        requests.add((about.initializer, tuple(sorted(about.options.items())), about.seed))
        if not facts and member.words.vector is None and about.initializer is None:
            expected = f"expected a fact or a word vector; {member.words.note}"
            raise InputError(repr(name)[:80], "", expected)
        known_facts += sum(not (head in inserted and tail in inserted) for head, _, tail in facts)
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


def components(given: Mapping[str, EntityInput]) -> Iterator[list[str]]:
    """The entities that a chain of facts joins to each other, sorted, one component after the
    other.
    """
    left = dict.fromkeys(sorted(given))
    while left:
        name = next(iter(left))
        reached, waiting = {name}, [name]
        while waiting:
            facts = given[waiting.pop()].facts
            ends = {end for head, _, tail in facts for end in (head, tail)}
            others = ends & given.keys() - reached
            reached |= others
            waiting += others
        for each in reached:
            del left[each]
        yield sorted(reached)
