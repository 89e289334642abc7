"""Vectors of entities that are inserted into one bundle.
What does not change between calls is prepared once.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, options_of
from isi.insertion import api
from isi.insertion.arguments import argument
from isi.insertion.choice import HIDDEN, hide
from isi.insertion.inverses import adapted
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.result import Inserted
from isi.live.folder import EntityRecord
from isi.live.journal import Additions, Chosen, NewEntity
from isi.live.loaded import Fact, LoadedEmbedding
from isi.live.names import plain
from isi.live.phrases import PhraseVector, PhraseVectors
from isi.live.stored import StoredVector, digest_of, key_of
from isi.models.stack import Embedding, without_denormals

#: Numbers of facts for which an initializer is chosen. The choice for the largest one serves
#: entities with more.
PREPARED = (0, 1, 2, 3, 5, 8)
#: Of the choice. With this tolerance, ten or twelve objects in a row lower the MRR of known triples
#: by at most 0.001 on AI2-THOR and on ``examples/home.csv``; with that of ``isi.insert``, 0.02, by
#: up to 0.024.
TOLERANCE, BUDGET = 0.013, 3.0
NO_WORDS = PhraseVector(None, "this embedding has no word vectors", None, None)


class Method(NamedTuple):
    """How entities are inserted together."""

    facts: int  #: with known entities; one of ``PREPARED``
    words: bool  #: whether all have word vectors
    initializer: str | None  #: None: the choice for so many facts
    options: tuple[tuple[str, Any], ...]
    seed: int


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An inserted entity as it stands: its record, its vector, its words and its kind."""

    record: EntityRecord  #: its facts are sorted
    vector: np.ndarray  #: shape: (d,)
    key: str  #: of all inputs of the vector (``isi.live.stored``)
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: sentences on its kind, its words and unusual facts


@dataclass(eq=False)
class EntityGroups:
    """Inserts entities into a bundle of known entities, each from its own facts and words alone."""

    base: LoadedEmbedding
    phrases: PhraseVectors | None
    #: by number of facts, and whether with words
    chosen: dict[tuple[int, bool], Chosen] = field(default_factory=dict)
    #: vectors that were computed before, by key
    stored: dict[str, StoredVector] = field(default_factory=dict)
    _curves: dict[tuple[Any, ...], Curves | None] = field(default_factory=dict)

    @cached_property
    def _digest(self) -> str:
        """Of all that vectors depend on beside what is inserted."""
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
        """The entities ``names``, and all that share facts with them,
        inserted from all their facts.

        An ``InputError`` names an entity that has neither facts nor words nor an initializer of its
        own.
        """
        groups = dict[tuple[Any, ...], list[str]]()
        facts, words = dict[str, list[Fact]](), dict[str, PhraseVector]()
        for name in additions.entities:
            if name in names and name not in facts:
                listed = _together(name, additions.of_entity)
                facts |= {each: sorted(additions.of_entity[each]) for each in listed}
                words |= {each: self.words(each, additions.entities[each]) for each in listed}
                method = self._method(listed, additions, facts, words)
                group = (method,) if len(listed) == 1 else (method, listed[0])
                groups.setdefault(group, []).extend(listed)
        known_triples = self.known_triples(additions)
        rows = dict[str, InsertedEntity]()
        for (method, *others), listed in groups.items():
            names, shares = sorted(listed), bool(others)
            rows |= self._insert(method, names, shares, additions, facts, words, known_triples)
        return rows

    def known_triples(self, additions: Additions) -> np.ndarray:
        """The triples of training that have not been retracted; ids, shape (T, 3)."""
        return self.base.triples_without(additions.retracted)

    def words(self, name: str, about: NewEntity) -> PhraseVector:
        """The word vector of a new entity, from its definition or its name."""
        return (
            NO_WORDS if self.phrases is None else self.phrases.vector(plain(name), about.definition)
        )

    def _method(
        self,
        names: Sequence[str],
        additions: Additions,
        facts: Mapping[str, list[Fact]],
        words: Mapping[str, PhraseVector],
    ) -> Method:
        """How entities that share facts are inserted."""
        requests = {
            (about.initializer, tuple(sorted(about.options.items())), about.seed)
            for name in names
            for about in [additions.entities[name]]
        }
        if len(requests) > 1:
            expected = (
                "expected one initializer, one set of options and one "
                "seed of entities that share a fact"
            )
            raise InputError(", ".join(names)[:80], "", expected)
        (request,) = requests
        for name in names:
            if not facts[name] and words[name].vector is None and request[0] is None:
                raise InputError(
                    repr(name)[:80], "", f"expected a fact or a word vector; {words[name].note}"
                )
        inserted = additions.entities.keys()
        known = [
            sum(not {head, tail} <= inserted for head, _, tail in facts[name]) for name in names
        ]
        return Method(
            prepared(sum(known) / len(known)),
            all(words[name].vector is not None for name in names),
            *request,
        )

    def _insert(
        self,
        method: Method,
        names: list[str],
        together: bool,
        additions: Additions,
        facts: Mapping[str, list[Fact]],
        words: Mapping[str, PhraseVector],
        known_triples: np.ndarray,
    ) -> dict[str, InsertedEntity]:
        """Insert entities by one method, in one call; ``together``: they share facts."""
        why, warnings = "as named", list[str]()
        if method.initializer is None:
            choice = self.choice(method.facts, method.words)
            why, warnings = choice.why, choice.warnings
        initializer, options = self._resolved(method)
        kinds, reasons = dict[str, str](), dict[str, str]()
        for name in names:
            about = additions.entities[name]
            kinds[name], reasons[name] = about.kind or "", ""
            if not about.kind:
                kinds[name], reasons[name] = self._kind(name, about, facts[name], words[name])
        inputs = {
            name: [name, facts[name], kinds[name], digest_of(words[name].vector)] for name in names
        }
        shared = [self._digest, initializer, options, method.seed, sorted(additions.retracted)]
        keys = {name: key_of(shared, inputs if together else inputs[name], name) for name in names}
        vectors = {name: self.stored[keys[name]] for name in names if keys[name] in self.stored}
        if missing := [name for name in names if name not in vectors]:
            missing = names if together else missing
            every = sorted({fact for name in missing for fact in facts[name]})
            of_missing = [kinds[name] for name in missing]
            result = self.insert(method, missing, every, words, of_missing, known_triples)
            computed = result.entities[len(self.base.entities) :]
            for name, vector, fallback in zip(missing, computed, result.fallback, strict=True):
                vectors[name] = StoredVector(vector.copy(), fallback)
        rows = dict[str, InsertedEntity]()
        for name in names:
            about = additions.entities[name]
            record = EntityRecord(
                entity=name,
                insert_triples=facts[name],
                definition=about.definition,
                requested_initializer=about.initializer,
                options=options,
                seed=about.seed,
                initializer=initializer,
                why=why,
                fallback=vectors[name].fallback,
            )
            no_words = words[name].vector is None
            note = f"{name} has no words: {words[name].note}" if no_words else ""
            unusual = self.base.kind_notes(facts[name], name)
            notes = tuple(filter(None, (reasons[name], note, *unusual, *warnings)))
            vector = vectors[name].vector
            rows[name] = InsertedEntity(record, vector, keys[name], words[name], kinds[name], notes)
        return rows

    def _resolved(self, method: Method) -> tuple[str, dict[str, Any]]:
        """The initializer of a method, and all its options."""
        if method.initializer is None:
            choice = self.choice(method.facts, method.words)
            return choice.initializer, dict(choice.options)
        with argument("initializer"):
            registered = INITIALIZERS.get(method.initializer, "initializer")
            given = {**registered.defaults, **dict(method.options)}
            return method.initializer, options_of(method.initializer, given, "initializer")

    def _kind(
        self, name: str, about: NewEntity, facts: list[Fact], words: PhraseVector
    ) -> tuple[str, str]:
        """The kind of a new entity, and the reason."""
        if self.phrases is None or words.vector is None:
            return self.base.kind_of(name, facts, None)
        return self.base.kind_of(name, facts, self.phrases.alike(plain(name), about.definition))

    def insert(
        self,
        method: Method,
        names: list[str],
        facts: Iterable[Fact],
        words: Mapping[str, PhraseVector],
        kinds: Sequence[str],
        known_triples: np.ndarray,
    ) -> Inserted:
        """``isi.insert`` with the bundle's data."""
        initializer, options = self._resolved(method)
        base, number = self.base, len(self.base.entities)
        ids = ChainMap({name: row for row, name in enumerate(names, number)}, base.entity_ids)
        triples = [
            (ids[head], base.relation_ids[relation], ids[tail]) for head, relation, tail in facts
        ]
        return api.insert(
            base.entities,
            base.relations,
            np.array(triples, np.int64).reshape(-1, 3),
            new=len(names),
            model=base.model,
            known_triples=known_triples,
            words=self.word_rows(names, words),
            kinds=self.kind_ids(kinds),
            initializer=initializer,
            options=options,
            seed=method.seed,
        )

    def kind_ids(self, kinds: Sequence[str]) -> np.ndarray:
        """A number for the kind of each known entity and of new ones, (E + n,);
        -1 without a kind.
        """
        new = [self.base.kind_numbers.get(kind, -1) for kind in kinds]
        return np.concatenate([self.base.kind_ids, np.array(new, np.int64)])

    def word_rows(
        self, names: Sequence[str], words: Mapping[str, PhraseVector]
    ) -> np.ndarray | None:
        """Word vectors of the known entities and of new ones, (E + n, v);
        None if no new one has words.
        """
        vectors, known = [words[name].vector for name in names], self.base.words
        if known is None or all(vector is None for vector in vectors):
            return None
        return with_rows(known, vectors)

    def choice(self, number: int, words: bool) -> Chosen:
        """The initializer for so many facts, chosen on hidden known
        entities and then remembered.
        """
        if (chosen := self.chosen.get((number, words))) is None:
            with without_denormals():
                hidden_from = self._hidden_from(number, words)
                name, options, why, best = api.default(
                    number > 0, words, *hidden_from, tolerance=TOLERANCE, budget=BUDGET
                )
            chosen = self.chosen[number, words] = Chosen(
                facts=number,
                words=words,
                initializer=name,
                options=options,
                why=why,
                warnings=best.warnings if best else [],
            )
        return chosen

    def curves(self, row: InsertedEntity) -> Curves | None:
        """The curves that calibrate answers about an inserted entity;
        None with too few known triples.
        """
        record = row.record
        number = prepared(len(record.insert_triples))
        return self._fit(number, row.words.vector is not None, record.initializer, record.options)

    def _fit(
        self, number: int, words: bool, initializer: str, options: Mapping[str, Any]
    ) -> Curves | None:
        """The curves for so many facts and an initializer, fitted once."""
        key = (number, words, initializer, tuple(sorted(options.items())))
        if key not in self._curves:
            adjusted = adapted(INITIALIZERS.get(initializer), self.base.model)
            with without_denormals():
                draws = (
                    hide(*self._hidden_from(number, words), HIDDEN)
                    if len(self.base.triples)
                    else None
                )
                self._curves[key] = None if draws is None else fit_curves(draws, adjusted, options)
        return self._curves[key]

    def _hidden_from(
        self, number: int, words: bool
    ) -> tuple[Embedding, np.ndarray, np.ndarray, np.ndarray | None, np.ndarray, int]:
        """What known entities are hidden from: the first arguments of ``choice.hide``."""
        base = self.base
        theta0 = replace(base.embedding, model=api.one_score(base.model))
        return (
            theta0,
            base.triples,
            np.array([number]),
            base.words if words else None,
            base.kind_ids,
            0,
        )

    def preparation(self) -> Iterator[Callable[[], object]]:
        """Steps that choose initializers and fit curves for all numbers of facts;
        some take a second.
        """
        for number, words in product(PREPARED, [False] if self.phrases is None else [False, True]):
            yield partial(self.choice, number, words)
            yield partial(self._fit_chosen, number, words)

    def _fit_chosen(self, number: int, words: bool) -> None:
        choice = self.choice(number, words)
        self._fit(number, words, choice.initializer, choice.options)


def prepared(facts: float) -> int:
    """The number in ``PREPARED`` that serves so many facts."""
    return max(number for number in PREPARED if number <= facts)


def _together(name: str, facts: Mapping[str, Collection[Fact]]) -> list[str]:
    """The inserted entities that a chain of facts joins to one of them, sorted;
    ``facts``: of each.
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
