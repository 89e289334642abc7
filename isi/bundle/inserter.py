"""Vectors of entities that are inserted into one bundle. What does not change between calls is prepared once."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from isi.bundle.folder import InsertionRecord
from isi.bundle.journal import Additions, Chosen, NewEntity
from isi.bundle.names import plain
from isi.bundle.phrases import PhraseVector, PhraseVectors
from isi.bundle.query import Fact, OpenBundle
from isi.errors import InputError
from isi.initializers.api import INITIALIZERS
from isi.insertion import api
from isi.insertion.choice import HIDDEN, hide
from isi.insertion.inverses import adapted
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.result import Inserted
from isi.models.stack import Embedding, without_denormals

#: Numbers of facts for which an initializer is chosen. The choice for the largest one serves entities with more.
PREPARED = (0, 1, 2, 3, 5, 8)
#: Of the choice. With this tolerance, ten or twelve objects in a row lower the MRR of known triples by at most 0.001 on
#: AI2-THOR and on ``examples/home.csv``; with that of ``isi.insert``, 0.02, by up to 0.024.
TOLERANCE, BUDGET = 0.013, 3.0
NO_WORDS = PhraseVector(None, "this embedding has no word vectors", None, None)


class Method(NamedTuple):
    """How entities are inserted together."""

    facts: int  #: with known entities; one of ``PREPARED``
    words: bool  #: whether all have word vectors
    initializer: str | None  #: null: the choice for so many facts
    options: tuple[tuple[str, Any], ...]
    seed: int


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An inserted entity as it stands: its record, its vector, its words and its kind."""

    record: InsertionRecord  #: its facts are sorted
    vector: np.ndarray  #: shape: (d,)
    words: PhraseVector
    kind: str
    notes: tuple[str, ...]  #: sentences on its kind, its words and unusual facts


@dataclass(eq=False)
class Inserter:
    """Inserts entities into a bundle of known entities, each from its own facts and words alone."""

    base: OpenBundle
    phrases: PhraseVectors | None
    chosen: dict[tuple[int, bool], Chosen] = field(default_factory=dict)  #: by number of facts, and whether with words
    _curves: dict[tuple[Any, ...], Curves | None] = field(default_factory=dict)

    def rows(self, additions: Additions, names: Collection[str]) -> dict[str, InsertedEntity]:
        """The entities ``names``, and all that share facts with them, inserted from all their facts.

        An ``InputError`` names an entity that has neither facts nor words nor an initializer of its own.
        """
        groups, done, facts = dict[tuple[Any, ...], list[str]](), set[str](), self.facts_of(additions)
        words = dict[str, PhraseVector]()
        for name in additions.entities:
            if name in names and name not in done:
                listed = _together(name, facts)
                done.update(listed)
                words |= {each: self.words(each, additions.entities[each]) for each in listed}
                method = self._method(listed, additions, facts, words)
                groups.setdefault((method,) if len(listed) == 1 else (method, listed[0]), []).extend(listed)
        rows = dict[str, InsertedEntity]()
        for (method, *_), together in groups.items():
            rows |= self._insert(method, sorted(together), additions, facts, words)
        return rows

    def words(self, name: str, about: NewEntity) -> PhraseVector:
        """The word vector of a new entity, from its definition or its name."""
        return NO_WORDS if self.phrases is None else self.phrases.vector(plain(name), about.definition)

    def facts_of(self, additions: Additions) -> dict[str, list[Fact]]:
        """The sorted facts of each inserted entity."""
        facts: dict[str, list[Fact]] = {name: [] for name in additions.entities}
        for fact in sorted(additions.facts):
            for end in {fact[0], fact[2]} & facts.keys():
                facts[end].append(fact)
        return facts

    def _method(
        self, names: Sequence[str], additions: Additions, facts: Mapping[str, list[Fact]],
        words: Mapping[str, PhraseVector],
    ) -> Method:  # fmt: skip
        """How entities that share facts are inserted."""
        requests = {(about.initializer, tuple(sorted(about.options.items())), about.seed) for name in names
                    for about in [additions.entities[name]]}  # fmt: skip
        if len(requests) > 1:
            expected = "expected one initializer, one set of options and one seed of entities that share a fact"
            raise InputError(", ".join(names)[:80], "", expected)
        (request,) = requests
        for name in names:
            if not facts[name] and words[name].vector is None and request[0] is None:
                raise InputError(repr(name)[:80], "", f"expected a fact or a word vector; {words[name].note}")
        known = [sum(not {head, tail} <= facts.keys() for head, _, tail in facts[name]) for name in names]
        return Method(
            prepared(sum(known) / len(known)), all(words[name].vector is not None for name in names), *request
        )

    def _insert(
        self, method: Method, names: list[str], additions: Additions, facts: Mapping[str, list[Fact]],
        words: Mapping[str, PhraseVector],
    ) -> dict[str, InsertedEntity]:  # fmt: skip
        """Insert entities by one method, in one call."""
        why, warnings = "as named", list[str]()
        if method.initializer is None:
            choice = self.choice(method.facts, method.words)
            why, warnings = choice.why, choice.warnings
        abouts = [additions.entities[name] for name in names]
        kinds = [
            (about.kind, "") if about.kind else self._kind(name, about, facts[name], words[name])
            for name, about in zip(names, abouts, strict=True)
        ]
        every = sorted({fact for name in names for fact in facts[name]})
        result = self.insert(method, names, every, words, [kind for kind, _ in kinds])
        rows, vectors = dict[str, InsertedEntity](), result.entities[len(self.base.entities) :]
        for name, about, (kind, reason), vector, fallback in zip(
            names, abouts, kinds, vectors, result.fallback, strict=True
        ):
            record = InsertionRecord(
                entity=name, insert_triples=facts[name], definition=about.definition,
                requested_initializer=about.initializer, options=dict(result.options), seed=about.seed,
                initializer=result.initializer, why=why, fallback=fallback,
            )  # fmt: skip
            note = f"{name} has no words: {words[name].note}" if words[name].vector is None else ""
            notes = (reason, note, *self.base.kind_notes(facts[name], name), *warnings)
            rows[name] = InsertedEntity(record, vector.copy(), words[name], kind, tuple(filter(None, notes)))
        return rows

    def _kind(self, name: str, about: NewEntity, facts: list[Fact], words: PhraseVector) -> tuple[str, str]:
        """The kind of a new entity, and the reason."""
        if self.phrases is None or words.vector is None:
            return self.base.kind_of(name, facts, None)
        return self.base.kind_of(name, facts, self.phrases.alike(plain(name), about.definition))

    def insert(
        self, method: Method, names: list[str], facts: Iterable[Fact], words: Mapping[str, PhraseVector],
        kinds: Sequence[str],
    ) -> Inserted:  # fmt: skip
        """``isi.insert`` with the bundle's data."""
        initializer, options = method.initializer, dict(method.options)
        if initializer is None:
            choice = self.choice(method.facts, method.words)
            initializer, options = choice.initializer, choice.options
        base, number = self.base, len(self.base.entities)
        ids = ChainMap({name: row for row, name in enumerate(names, number)}, base.entity_ids)
        triples = [(ids[head], base.relation_ids[relation], ids[tail]) for head, relation, tail in facts]
        return api.insert(
            base.entities, base.relations, np.array(triples, np.int64).reshape(-1, 3), new=len(names),
            model=base.model, known_triples=base.triples, words=self.word_rows(names, words),
            kinds=self.kind_ids(kinds), initializer=initializer, options=options, seed=method.seed,
        )  # fmt: skip

    def kind_ids(self, kinds: Sequence[str]) -> np.ndarray:
        """A number for the kind of each known entity and of new ones, (E + n,); -1 without a kind."""
        new = [self.base.kind_numbers.get(kind, -1) for kind in kinds]
        return np.concatenate([self.base.kind_ids, np.array(new, np.int64)])

    def word_rows(self, names: Sequence[str], words: Mapping[str, PhraseVector]) -> np.ndarray | None:
        """Word vectors of the known entities and of new ones, (E + n, v); null if no new one has words."""
        vectors, known = [words[name].vector for name in names], self.base.words
        if known is None or all(vector is None for vector in vectors):
            return None
        return with_rows(known, vectors)

    def choice(self, number: int, words: bool) -> Chosen:
        """The initializer for so many facts, chosen on hidden known entities and then remembered."""
        if (chosen := self.chosen.get((number, words))) is None:
            with without_denormals():
                hidden_from = self._hidden_from(number, words)
                name, options, why, best = api.default(
                    number > 0, words, *hidden_from, tolerance=TOLERANCE, budget=BUDGET
                )
            chosen = self.chosen[number, words] = Chosen(
                facts=number, words=words, initializer=name, options=options, why=why,
                warnings=best.warnings if best else [],
            )  # fmt: skip
        return chosen

    def curves(self, row: InsertedEntity) -> Curves | None:
        """The curves that calibrate answers about an inserted entity; null with too few known triples."""
        record = row.record
        number = prepared(len(record.insert_triples))
        return self._fit(number, row.words.vector is not None, record.initializer, record.options)

    def _fit(self, number: int, words: bool, initializer: str, options: Mapping[str, Any]) -> Curves | None:
        """The curves for so many facts and an initializer, fitted once."""
        key = (number, words, initializer, tuple(sorted(options.items())))
        if key not in self._curves:
            adjusted = adapted(INITIALIZERS.get(initializer), self.base.model)
            with without_denormals():
                draws = hide(*self._hidden_from(number, words), HIDDEN) if len(self.base.triples) else None
                self._curves[key] = None if draws is None else fit_curves(draws, adjusted, options)
        return self._curves[key]

    def _hidden_from(
        self, number: int, words: bool
    ) -> tuple[Embedding, np.ndarray, np.ndarray, np.ndarray | None, np.ndarray, int]:
        """What known entities are hidden from: the first arguments of ``choice.hide``."""
        base = self.base
        theta0 = replace(base.embedding, model=api.one_score(base.model))
        return theta0, base.triples, np.array([number]), base.words if words else None, base.kind_ids, 0

    def prepare(self) -> Iterator[None]:
        """Choose initializers and fit curves for all numbers of facts, a step at each ``next``."""
        for number, words in product(PREPARED, [False] if self.phrases is None else [False, True]):
            choice = self.choice(number, words)
            yield
            self._fit(number, words, choice.initializer, choice.options)
            yield


def prepared(facts: float) -> int:
    """The number in ``PREPARED`` that serves so many facts."""
    return max(number for number in PREPARED if number <= facts)


def _together(name: str, facts: Mapping[str, Sequence[Fact]]) -> list[str]:
    """The inserted entities that a chain of facts joins to one of them, sorted; ``facts``: of each."""
    reached, waiting = {name}, [name]
    while waiting:
        others = {end for head, _, tail in facts[waiting.pop()] for end in (head, tail)} & facts.keys() - reached
        reached |= others
        waiting += others
    return sorted(reached)


def with_rows(known: np.ndarray, vectors: Sequence[np.ndarray | None]) -> np.ndarray:
    """A table, (E, v), with a row for each of n vectors, zeros where there is none; shape (E + n, v)."""
    added = np.zeros((len(vectors), known.shape[1]), known.dtype)
    for row, vector in zip(added, vectors, strict=True):
        if vector is not None:
            row[:] = vector
    return np.concatenate([known, added])
