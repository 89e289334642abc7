"""Vectors of entities that are inserted into a home; those that share facts go in together."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast
from zlib import crc32

import numpy as np
import torch

from isi.errors import InputError
from isi.home.bundle import Fact
from isi.home.choices import Choices, prepared
from isi.home.inserted import Choice, InsertedEntity, Key, NewEntity, requested
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import NO_WORDS, PhraseVectors
from isi.initializers.api import FALLBACKS, InitResult
from isi.initializers.scale import Scale, fit_scale
from isi.insertion.api import run_engine
from isi.insertion.engine import NovelEntities
from isi.insertion.relations import fit_relations
from isi.insertion.selection import named
from isi.models.losses import loss_named
from isi.models.stack import usual_torch
from isi.names import plain
from isi.vocabulary import ids_by_name


@dataclass(frozen=True, eq=False)
class EntityGroups:
    """Inserts entities into a bundle of known entities, each from its own facts and words, together
    with those that share facts with it.
    """

    base: LoadedEmbedding
    phrases: PhraseVectors | None
    choices: Choices

    def member(self, name: str, about: Mapping[str, Any], facts: Mapping[Fact, float]) -> NewEntity:
        """A new entity with its words and its kind.

        ``about``: what was told, by field; ``facts``: those of relations of training, and how far
        each is believed.
        """
        new = NewEntity(**about, facts=facts)
        words, kind, reason = NO_WORDS, new.kind or "", ""
        if self.phrases is not None:
            words = self.phrases.vector(plain(name), new.definition)
        if not kind:
            alike = None
            if self.phrases is not None and words.vector is not None:
                alike = self.phrases.alike(plain(name), new.definition)
            kind, reason = self.base.kind_of(name, facts, alike)
        no_words = f"{name} has no words: {words.note}" if words.vector is None else ""
        notes = filter(None, [reason, no_words, *self.base.kind_notes(facts, name)])
        return replace(new, kind=kind, words=words, notes=tuple(notes))

    def insert(
        self, members: Mapping[str, NewEntity], known_triples: np.ndarray
    ) -> dict[str, InsertedEntity]:
        """Insert entities, each with all that share facts with it.

        ``known_triples``: those of training that hold; ids, (T, 3). An ``InputError`` names an
        entity that has neither facts nor words nor an initializer of its own.
        """
        members = dict(sorted(members.items()))
        groups = dict[tuple[Key, int, str], dict[str, NewEntity]]()
        for names in components(members):
            together = {name: members[name] for name in names}
            key, seed = _key_and_seed(together, members.keys())
            # entities that share no facts are inserted at once if their keys are equal
            alone = names[0] if len(names) > 1 else ""
            groups.setdefault((key, seed, alone), {}).update(together)
        inserted = dict[str, InsertedEntity]()
        for (key, seed, _), together in groups.items():
            choice = self.choices.needed(key)
            novel, result = self._insert(choice, seed, together, known_triples)
            vectors = novel.theta.entity[0, novel.known :].numpy().astype(self.base.entities.dtype)
            for place, (name, member) in enumerate(together.items()):
                inserted[name] = InsertedEntity(
                    entity=name,
                    vector=vectors[place].copy(),
                    kind=member.kind or "",
                    initializer=choice.initializer,
                    options=choice.options,
                    why=choice.why,
                    fallback=FALLBACKS[int(result.fallback[0, place])],
                    notes=member.notes,
                    key=key,
                )
        return inserted

    def again(
        self, members: Mapping[str, NewEntity], known_triples: np.ndarray, row: InsertedEntity
    ) -> tuple[NovelEntities, InitResult]:
        """What the engine says of entities that share facts, sorted by name, when they are inserted
        as one of them was, whose ``row`` it is.
        """
        choice = self.choices.find(row.key)
        if choice is None:
            choice = Choice(row.initializer, row.options, row.why, "logistic", (), None)
        _, seed = _key_and_seed(members, members)
        return self._insert(choice, seed, members, known_triples)

    @usual_torch()
    def _insert(
        self,
        choice: Choice,
        seed: int,
        members: Mapping[str, NewEntity],
        known_triples: np.ndarray,
    ) -> tuple[NovelEntities, InitResult]:
        """Insert the entities of a group, sorted by name, into the bundle's embedding: what was
        given to the engine, with their vectors in its last rows, and what the engine says.
        """
        base, number = self.base, len(self.base.entities)
        ids = ChainMap({name: row for row, name in enumerate(members, number)}, base.names.ids)
        facts = dict[Fact, float]()
        for member in members.values():
            facts |= member.facts
        facts = {fact: facts[fact] for fact in sorted(facts)}
        doubtful = any(believed < 1 for believed in facts.values())
        loss = base.manifest.loss or choice.trained_with
        method = named(choice.initializer, dict(choice.options), base.model, number + len(members))
        scale = Scale(loss_named(loss))
        if method.initializer.cost == "newton":
            scale = fit_scale(base.embedding, torch.from_numpy(known_triples), loss)
        known = base.embedding.entity
        rows = torch.cat([known, known.new_zeros(1, len(members), known.shape[2])], 1)
        novel = NovelEntities(
            theta=replace(base.embedding, entity=rows),
            known=number,
            number=len(members),
            known_relations=len(base.relations),
            triples=ids_by_name(facts, ids, base.labels.ids),
            known_triples=known_triples,
            words=self._word_rows([member.words.vector for member in members.values()]),
            kinds=self._kind_ids([member.kind for member in members.values()]),
            seed=seed,
            scale=scale,
            entity_keys=np.array([crc32(name.encode()) for name in members], np.int64),
            confidence=np.array(list(facts.values())) if doubtful else None,
        )
        result = run_engine(novel, method, list(members).__getitem__)
        return novel, cast("InitResult", result)  # there are new entities

    def _kind_ids(self, kinds: Sequence[str | None]) -> np.ndarray:
        """A number for the kind of each known entity and of new ones, (E + n,); -1 without one."""
        new = [self.base.kind_numbers.get(kind or "", -1) for kind in kinds]
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


def _key_and_seed(members: Mapping[str, NewEntity], inserted: Collection[str]) -> tuple[Key, int]:
    """The key of the choice for entities that share facts, and their seed."""
    requests, known_facts = set(), 0
    for name, member in members.items():
        requests.add((requested(member.initializer, member.options), member.seed))
        if not member.facts and member.words.vector is None and member.initializer is None:
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
    ((initializer, seed),) = requests
    all_have_words = all(member.words.vector is not None for member in members.values())
    return (prepared(known_facts / len(members)), all_have_words, initializer), seed


def components(members: Mapping[str, NewEntity]) -> Iterator[list[str]]:
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
