"""Vectors of entities that are inserted into one bundle. What does not change between calls is prepared once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import networkx as nx
import numpy as np

from isi.bundle.folder import InsertionRecord
from isi.bundle.journal import Additions, Chosen, NewEntity
from isi.bundle.names import plain
from isi.bundle.phrases import PhraseVector, PhraseVectors
from isi.bundle.query import Fact, OpenBundle
from isi.errors import InputError
from isi.initializers.api import INITIALIZERS
from isi.insertion import api
from isi.insertion.choice import HIDDEN, calibrated, hide
from isi.insertion.inverses import adapted
from isi.insertion.probability import Curves, fit_curves
from isi.insertion.result import Inserted
from isi.models.stack import Embedding, without_denormals

#: Numbers of facts for which an initializer is chosen. The choice for the largest one serves entities with more.
PREPARED = (0, 1, 2, 3, 5, 8)
TOLERANCE, BUDGET = 0.02, 3.0  #: Of the choice, as in ``isi.insert``.
NO_WORDS = PhraseVector(None, "this embedding has no word vectors", None, None)


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

    @cached_property
    def _known(self) -> tuple[Embedding, np.ndarray, np.ndarray]:
        """What entities are hidden from: the embedding, its triples, and kinds as numbers."""
        model = api.one_score(self.base.model)
        return replace(self.base.embedding, model=model), self.base.triples, self.base.kind_ids + 1

    def rows(self, additions: Additions, names: Collection[str]) -> dict[str, InsertedEntity]:
        """The entities ``names``, and all that share facts with them, inserted from all their facts.

        An ``InputError`` names an entity that has neither facts nor words nor an initializer of its own.
        """
        graph = nx.Graph()
        graph.add_nodes_from(additions.entities)
        graph.add_edges_from(
            (head, tail) for head, _, tail in additions.facts if {head, tail} <= additions.entities.keys()
        )
        groups = dict[tuple[Any, ...], list[str]]()
        words, facts = dict[str, PhraseVector](), self.facts_of(additions)
        for component in nx.connected_components(graph.subgraph(_reached(graph, names))):
            listed = sorted(component)
            words |= {name: self.words(name, additions.entities[name]) for name in listed}
            key = self._method(listed, additions, facts, words)
            groups.setdefault(key if len(listed) == 1 else (*key, listed[0]), []).extend(listed)
        rows = dict[str, InsertedEntity]()
        for key, together in groups.items():
            rows |= self._insert(key, sorted(together), additions, facts, words)
        return rows

    def stored(self, larger: OpenBundle, additions: Additions) -> dict[str, InsertedEntity]:
        """The inserted entities of a bundle whose input is still the same; no vector has to be computed for them."""
        first, stored, facts = len(self.base.entities), dict[str, InsertedEntity](), self.facts_of(additions)
        for row, record in enumerate(larger.manifest.inserted, first):
            if (about := additions.entities.get(name := record.entity)) is None:
                continue
            words, about_kind = self.words(name, about), self._kind(name, about, facts[name], NO_WORDS)
            defaults = {} if about.initializer is None else INITIALIZERS.get(about.initializer).defaults
            method = about.initializer, {**defaults, **about.options}
            if (
                (record.definition, record.seed) == (about.definition, about.seed)
                and sorted(record.insert_triples) == facts[name] and about_kind[0] in ("", larger.kinds[row])
                and method in ((record.requested_initializer, {}), (record.initializer, record.options))
            ):  # fmt: skip
                notes = self._notes(name, facts[name], words, about_kind[1])
                stored[name] = InsertedEntity(record, larger.entities[row], words, larger.kinds[row], notes)
        return stored

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
    ) -> tuple[Any, ...]:  # fmt: skip
        """How entities that share facts are inserted: number of facts, with words, initializer, options, seed."""
        numbers = [
            sum(not {head, tail} <= additions.entities.keys() for head, _, tail in facts[name]) for name in names
        ]
        requests = {(about.initializer, tuple(sorted(about.options.items())), about.seed) for name in names
                    for about in [additions.entities[name]]}  # fmt: skip
        if len(requests) > 1:
            expected = "expected one initializer, one set of options and one seed of entities that share a fact"
            raise InputError(", ".join(names)[:80], "", expected)
        (request,) = requests
        for name in names:
            if not facts[name] and words[name].vector is None and request[0] is None:
                raise InputError(repr(name)[:80], "", f"expected a fact or a word vector; {words[name].note}")
        number = max(each for each in PREPARED if each <= np.mean(numbers))
        return number, all(words[name].vector is not None for name in names), *request

    def _insert(
        self, key: tuple[Any, ...], names: list[str], additions: Additions, facts: Mapping[str, list[Fact]],
        words: Mapping[str, PhraseVector],
    ) -> dict[str, InsertedEntity]:  # fmt: skip
        """Insert entities by one method, in one call."""
        number, has_words, initializer, *_ = key
        kinds = {name: self._kind(name, additions.entities[name], facts[name], words[name]) for name in names}
        result = self.insert(key, names, sorted({fact for name in names for fact in facts[name]}), words, kinds)
        why, warnings = "as named", list[str]()
        if initializer is None:
            choice = self.choice(number, has_words)
            why, warnings = choice.why, choice.warnings
        rows = {}
        for name, vector, fallback in zip(
            names, result.entities[len(self.base.entities) :], result.fallback, strict=True
        ):
            about = additions.entities[name]
            kind, reason = kinds[name]
            record = InsertionRecord(
                entity=name, insert_triples=facts[name], definition=about.definition,
                requested_initializer=about.initializer, options=dict(result.options), seed=about.seed,
                initializer=result.initializer, why=why, fallback=fallback,
            )  # fmt: skip
            notes = (*self._notes(name, facts[name], words[name], reason), *warnings)
            rows[name] = InsertedEntity(record, vector.copy(), words[name], kind, notes)
        return rows

    def _notes(self, name: str, facts: Iterable[Fact], words: PhraseVector, reason: str) -> tuple[str, ...]:
        """Sentences on the kind of an entity, with its ``reason``, on missing words and on unusual facts."""
        note = f"{name} has no words: {words.note}" if words.vector is None else ""
        return tuple(filter(None, (reason, note, *self.base.kind_notes(facts, name))))

    def insert(
        self, key: tuple[Any, ...], names: list[str], facts: Iterable[Fact], words: Mapping[str, PhraseVector],
        kinds: Mapping[str, tuple[str, str]],
    ) -> Inserted:  # fmt: skip
        """``isi.insert`` with the bundle's data; ``key``: as ``_method`` gives it."""
        number, has_words, initializer, options, seed, *_ = key
        if initializer is None:
            choice = self.choice(number, has_words)
            initializer, options = choice.initializer, choice.options
        base, table = self.base, self.word_rows(names, words)
        ids = base.entity_ids | {name: row for row, name in enumerate(names, len(base.entities))}
        triples = [(ids[head], base.relation_ids[relation], ids[tail]) for head, relation, tail in facts]
        return api.insert(
            base.entities, base.relations, np.array(triples, np.int64).reshape(-1, 3), new=len(names),
            model=base.model, known_triples=base.triples, words=table,
            kinds=[*base.kinds, *(kinds[name][0] for name in names)], initializer=initializer, options=dict(options),
            seed=seed,
        )  # fmt: skip

    def word_rows(self, names: Sequence[str], words: Mapping[str, PhraseVector]) -> np.ndarray | None:
        """Word vectors of the known entities and of new ones, (E + n, v); null if no new one has words."""
        vectors, known = [words[name].vector for name in names], self.base.words
        if known is None or all(vector is None for vector in vectors):
            return None
        return with_rows(known, vectors)

    def _kind(self, name: str, about: NewEntity, facts: Iterable[Fact], words: PhraseVector) -> tuple[str, str]:
        """The kind of a new entity, and where it is from."""
        return (about.kind, "") if about.kind else self.base.kind_of(name, facts, words.nearest)

    def choice(self, number: int, words: bool) -> Chosen:
        """The initializer for so many facts, chosen on hidden known entities and then remembered."""
        if (chosen := self.chosen.get((number, words))) is None:
            theta0, triples, kinds = self._known
            name, why = api.best(theta0, number > 0, words)
            options, warnings = dict(INITIALIZERS.get(name).defaults), list[str]()
            first = adapted(INITIALIZERS.get(name), self.base.model)
            listed = [first, *api.compared(theta0, number > 0, words, len(self.base.entities), name)]
            vectors = self.base.words if words else None
            with without_denormals():
                best = calibrated(listed, theta0, triples, np.array([number]), vectors, kinds, 0, TOLERANCE, BUDGET)
            if best is not None:
                name, options, why = best.chosen.initializer, dict(best.chosen.options), best.why
                warnings = best.warnings
            chosen = Chosen(facts=number, words=words, initializer=name, options=options, why=why, warnings=warnings)
            self.chosen[number, words] = chosen
        return chosen

    def curves(self, row: InsertedEntity) -> Curves | None:
        """The curves that calibrate answers about an inserted entity; null with too few known triples."""
        record, words = row.record, row.words.vector is not None
        number = max(each for each in PREPARED if each <= len(record.insert_triples))
        return self._fit(number, words, record.initializer, record.options)

    def _fit(self, number: int, words: bool, initializer: str, options: Mapping[str, Any]) -> Curves | None:
        """The curves for so many facts and an initializer, fitted once."""
        key = (number, words, initializer, tuple(sorted(options.items())))
        if key not in self._curves:
            theta0, triples, kinds = self._known
            vectors, adjusted = self.base.words if words else None, adapted(INITIALIZERS.get(initializer), theta0.model)
            with without_denormals():
                draws = hide(theta0, triples, np.array([number]), vectors, kinds, 0, HIDDEN) if len(triples) else None
                self._curves[key] = None if draws is None else fit_curves(draws, adjusted, options)
        return self._curves[key]

    def prepare(self) -> Iterator[None]:
        """Choose initializers and fit curves for all numbers of facts, a step at each ``next``."""
        for number, words in product(PREPARED, [False] if self.phrases is None else [False, True]):
            choice = self.choice(number, words)
            yield
            self._fit(number, words, choice.initializer, choice.options)
            yield


def _reached(graph: nx.Graph, names: Collection[str]) -> set[str]:
    """The nodes that are connected with one of ``names``."""
    return set().union(*(nx.node_connected_component(graph, name) for name in names if name in graph))


def with_rows(known: np.ndarray, vectors: Sequence[np.ndarray | None]) -> np.ndarray:
    """A table, (E, v), with a row for each of n vectors, zeros where there is none; shape (E + n, v)."""
    added = np.zeros((len(vectors), known.shape[1]), known.dtype)
    for row, vector in zip(added, vectors, strict=True):
        if vector is not None:
            row[:] = vector
    return np.concatenate([known, added])
