"""Vectors of entities that are inserted into a home; those that share facts go in together."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
import torch

from isi.errors import InputError
from isi.home.bundle import Fact, NewEntity
from isi.home.choices import Choices, prepared
from isi.home.inserted import Choice, InsertedEntity, Key, requested
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import PhraseVector, PhraseVectors
from isi.initializers.scale import fit_scale
from isi.insertion.api import insert_request
from isi.insertion.relations import fit_relations
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.insertion.result import Details
from isi.models.stack import usual_torch
from isi.names import plain
from isi.vocabulary import ids_by_name

NO_WORDS = PhraseVector(None, "this embedding has no word vectors")


@dataclass(frozen=True, eq=False)
class Member:
    """An entity that is to be inserted: what was told about it, and what its name says."""

    about: NewEntity
    facts: Mapping[Fact, float]  #: by relations of training, sorted, and how far each is believed
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: sentences on its kind, its words and unusual facts


@dataclass(frozen=True, eq=False)
class EntityGroups:
    """Inserts entities into a bundle of known entities, each from its own facts and words, together
    with those that share facts with it.
    """

    base: LoadedEmbedding
    phrases: PhraseVectors | None
    choices: Choices

    def member(self, name: str, about: NewEntity, facts: Mapping[Fact, float]) -> Member:
        """A new entity with its words and its kind; ``facts``: those of relations of training, and
        how far each is believed.
        """
        words = self.words(name, about.definition)
        kind, reason = about.kind or "", ""
        if not about.kind:
            alike = None
            if self.phrases is not None and words.vector is not None:
                alike = self.phrases.alike(plain(name), about.definition)
            kind, reason = self.base.kind_of(name, facts, alike)
        no_words = f"{name} has no words: {words.note}" if words.vector is None else ""
        notes = [reason, no_words, *self.base.kind_notes(facts, name)]
        return Member(about, facts, words, kind, tuple(filter(None, notes)))

    def words(self, name: str, definition: str | None) -> PhraseVector:
        """The word vector of a new entity, from its definition or its name."""
        if self.phrases is None:
            return NO_WORDS
        return self.phrases.vector(plain(name), definition)

    def insert(
        self, members: Mapping[str, Member], known_triples: np.ndarray
    ) -> dict[str, InsertedEntity]:
        """Insert entities, each with all that share facts with it.

        ``known_triples``: those of training that hold; ids, (T, 3). An ``InputError`` names an
        entity that has neither facts nor words nor an initializer of its own.
        """
        members = dict(sorted(members.items()))
        groups = dict[tuple[Key, int, str], dict[str, Member]]()
        for names in components(members):
            together = {name: members[name] for name in names}
            key, seed = _key_and_seed(together, members.keys())
            # entities that share no facts are inserted at once if their keys are equal
            alone = names[0] if len(names) > 1 else ""
            groups.setdefault((key, seed, alone), {}).update(together)
        inserted = dict[str, InsertedEntity]()
        for (key, seed, _), together in groups.items():
            choice = self.choices.needed(key)
            result = self._insert(choice, seed, together, known_triples)
            for place, (name, member) in enumerate(together.items()):
                inserted[name] = InsertedEntity(
                    entity=name,
                    vector=result.vectors[place].copy(),
                    kind=member.kind,
                    initializer=choice.initializer,
                    options=choice.options,
                    why=choice.why,
                    fallback=result.fallback[place],
                    notes=member.notes,
                    key=key,
                )
        return inserted

    def result(
        self, members: Mapping[str, Member], known_triples: np.ndarray, row: InsertedEntity
    ) -> Details:
        """All that the engine says of entities that share facts, sorted by name, when they are
        inserted as one of them was, whose ``row`` it is.
        """
        choice = self.choices.find(row.key)
        if choice is None:
            choice = Choice(row.initializer, row.options, row.why, "logistic", (), None)
        _, seed = _key_and_seed(members, members)
        return self._insert(choice, seed, members, known_triples)

    def _insert(
        self,
        choice: Choice,
        seed: int,
        members: Mapping[str, Member],
        known_triples: np.ndarray,
    ) -> Details:
        """Insert the entities of a group, sorted by name, into the bundle's embedding."""
        base = self.base
        new = {name: row for row, name in enumerate(members, len(base.entities))}
        ids = ChainMap(new, base.names.ids)
        facts = dict[Fact, float]()
        for member in members.values():
            facts |= member.facts
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
            seed=seed,
            entity_keys=np.array([crc32(name.encode()) for name in members], np.int64),
            confidence=list(facts.values()) if doubtful else None,
        )
        known = KnownEmbedding(base.entities, base.relations, base.model, triples=known_triples)
        return insert_request(known, request).details

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

    @usual_torch()
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


def _key_and_seed(members: Mapping[str, Member], inserted: Collection[str]) -> tuple[Key, int]:
    """The key of the choice for entities that share facts, and their seed."""
    requests, known_facts = set(), 0
    for name, member in members.items():
        about, facts = member.about, member.facts
        requests.add((requested(about.initializer, about.options), about.seed))
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
    ((initializer, seed),) = requests
    all_have_words = all(member.words.vector is not None for member in members.values())
    return (prepared(known_facts / len(members)), all_have_words, initializer), seed


def components(members: Mapping[str, Member]) -> Iterator[list[str]]:
    """The entities that a chain of facts joins to each other, sorted, one component after the
    other.
    """
    left = dict.fromkeys(sorted(members))
    while left:
        name = next(iter(left))
        reached, waiting = {name}, [name]
        while waiting:
            facts = members[waiting.pop()].facts
            ends = {end for head, _, tail in facts for end in (head, tail)}
            others = ends & members.keys() - reached
            reached |= others
            waiting += others
        for name in reached:
            del left[name]
        yield sorted(reached)
