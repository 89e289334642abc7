"""Queries to a bundle: scores, known answers, candidates, nearest entities."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial, wraps
from typing import TYPE_CHECKING, Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import numpy as np

from isi.config import check
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.home.bundle import Bundle, Fact
from isi.home.facts import StoredFact
from isi.home.phrases import unit
from isi.models.arrays import SCALARS, TRANSLATIONS, ArrayScores, ModelOptions, ModelScores, Scores
from isi.vocabulary import Vocabulary, ids_by_name

if TYPE_CHECKING:  # PyTorch takes a second to import
    from isi.models.model import Model
    from isi.models.stack import Embedding

USUAL = 0.1  #: Share of entities for which a kind is usual in a slot.
#: Without facts, a known entity counts for the kind of a new one with the weight exp(cosine of the
#: words / this).
TEMPERATURE = 0.07
P = ParamSpec("P")
R = TypeVar("R")


class Query(NamedTuple):
    """A query by ids: (given, relation, ?) if the slot is ``TAIL``,
    (?, relation, given) if it is ``HEAD``.
    """

    given: int
    relation: int
    slot: int


def remembered(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """A method of an object that does not change, which keeps what the method gave."""

    @wraps(method)
    def of(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> R:
        given: dict[Any, R] = vars(self).setdefault(f"_{method.__name__}", {})
        key = (*args, *kwargs.items())
        if key not in given:
            given[key] = method(self, *args, **kwargs)
        return given[key]

    return of


@dataclass(frozen=True, eq=False)
class LoadedEmbedding(Bundle):
    """A bundle with its scoring function."""

    scoring: Model | None = None  #: None: the model that the manifest names
    inserted: int = 0  #: number of inserted entities, which have the last rows
    added: int = 0  #: number of facts added after training, which are the last triples
    #: how far a fact is believed, by its ids; those that are not here: fully
    beliefs: Mapping[tuple[int, ...], float] = field(default_factory=dict)
    #: facts that no longer hold, and are no answers; ids, shape: (K, 3)
    retracted: np.ndarray = field(default_factory=partial(np.zeros, (0, 3), np.int64))

    @cached_property
    def model(self) -> Model:
        from isi.insertion.arguments import checked_model

        return self.scoring or checked_model(
            self.manifest.model_name, self.manifest.model_options, self.entities.shape[1]
        )

    @cached_property
    def embedding(self) -> Embedding:
        """The tables as a stack of one embedding in single precision."""
        from isi.insertion.arguments import table
        from isi.insertion.request import stack_of_one

        relations = table(self.relations, "relations", self.model.width(self.entities.shape[1]))
        return stack_of_one(self.entities, relations, self.model)

    @cached_property
    def names(self) -> Vocabulary:
        return Vocabulary("entity", self.entity_names)

    @cached_property
    def labels(self) -> Vocabulary:
        return Vocabulary("relation", self.relation_names)

    def answers(self, query: Query) -> set[int]:
        """The known answers of a query."""
        return answers_in(self.of_relation(query.relation), query)

    def belief(self, query: Query, answer: int) -> float:
        """How far the fact of a known answer is believed."""
        ends = (query.given, answer) if query.slot == TAIL else (answer, query.given)
        return self.beliefs.get((ends[0], query.relation, ends[1]), 1.0)

    @remembered
    def of_relation(self, relation: int) -> np.ndarray:
        """The known triples of a relation, (T, 3)."""
        triples: np.ndarray = self.triples[self.triples[:, RELATION] == relation]
        return triples

    def ids_of(self, facts: Iterable[Fact]) -> np.ndarray:
        """Facts by name as ids, shape (F, 3), int64."""
        return ids_by_name(list(facts), self.names.ids, self.labels.ids)

    def has_names_of(self, fact: Fact) -> bool:
        """Whether entities and relation of a fact are rows."""
        head, relation, tail = fact
        return relation in self.labels.ids and head in self.names.ids and tail in self.names.ids

    def beliefs_of(self, facts: Iterable[StoredFact]) -> dict[tuple[int, ...], float]:
        """``beliefs`` of facts; without those whose names have no row."""
        rows = {row.fact: row.confidence or 1.0 for row in facts if self.has_names_of(row.fact)}
        ids = self.ids_of(rows).tolist()
        return {tuple(fact): belief for fact, belief in zip(ids, rows.values(), strict=True)}

    def keys_of(self, triples: np.ndarray) -> np.ndarray:
        """A number for each triple of ids, (T, 3); equal triples have equal numbers."""
        head, relation, tail = triples.T
        number = len(self.entities)
        keys: np.ndarray = (relation * number + head) * number + tail
        return keys

    def triples_without(self, facts: Collection[Fact]) -> np.ndarray:
        """The known triples but some, given by name; shape (T, 3)."""
        if not facts:
            return self.triples
        left_out = self.keys_of(self.ids_of(facts))
        return self.triples[~np.isin(self.keys_of(self.triples), left_out)]

    @cached_property
    def scores(self) -> Scores:
        name = self.manifest.model_name
        if self.scoring is not None or name not in (*SCALARS, *TRANSLATIONS):
            return ModelScores(self.embedding)
        options = check(self.manifest.model_options, ModelOptions, "model_options", "manifest")
        tables = (table.astype(np.float32, copy=False) for table in (self.entities, self.relations))
        return ArrayScores(name, options, *tables)

    @remembered
    def in_slot(self, relation: int, slot: int) -> list[int]:
        """The ids of the entities in a slot of the known triples of a relation, sorted."""
        ids: list[int] = distinct(self.of_relation(relation)[:, slot]).tolist()
        return ids

    @cached_property
    def kind_numbers(self) -> dict[str, int]:
        return {kind: number for number, kind in enumerate(dict.fromkeys(filter(None, self.kinds)))}

    @cached_property
    def kind_ids(self) -> np.ndarray:
        """A number for each entity's kind, (E,); -1 without a kind."""
        return np.array([self.kind_numbers.get(kind, -1) for kind in self.kinds])

    def candidates(self, relation: int, slot: int) -> np.ndarray:
        """Ids of entities without a kind, or of a usual kind in this slot of known triples;
        all if it has no kinds.

        Usual is a kind that at least two entities, or a tenth of those in the other slot, have in
        their triples.
        """
        triples = self.of_relation(relation)
        others, kinds = triples[:, HEAD + TAIL - slot], self.kind_ids[triples[:, slot]]
        number = len(self.entities)
        pairs = distinct(kinds[kinds >= 0] * number + others[kinds >= 0]) // number
        usual, support = np.unique(pairs, return_counts=True)
        usual = usual[(support > 1) | (support >= USUAL * len(distinct(others)))]
        fits = (
            (self.kind_ids < 0) | np.isin(self.kind_ids, usual)
            if len(pairs)
            else np.full(len(self.kinds), True)
        )
        return np.flatnonzero(fits)

    def ranked(
        self, query: Query, among: Collection[int] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Candidates and known answers, or the entities ``among`` which to rank, best first, and
        scores, without retracted answers.

        The given entity is excluded unless it is an answer.
        """
        if among is None:
            fitting = set(self.candidates(query.relation, query.slot).tolist()) - {query.given}
            among = fitting | self.answers(query)
        listed = set(among) - answers_in(self.retracted, query)
        candidates = np.array(sorted(listed), np.int64)
        score = self.scores.tails if query.slot == TAIL else self.scores.heads
        scores = score(np.array([query.given]), query.relation)[0, candidates]
        best = best_first(scores)
        return candidates[best], scores[best]

    def nearest(self, entity: int, number: int) -> list[tuple[int, float]]:
        """The ``number`` other entities with the highest cosine to ``entity``,
        and these cosines, best first.
        """
        vectors = unit(self.entities)
        cosines = vectors @ vectors[entity]
        best = best_first(cosines)
        others = best[best != entity][:number]
        return list(zip(others.tolist(), cosines[others].tolist(), strict=True))

    def kind_notes(self, facts: Iterable[Fact], new: str) -> Iterator[str]:
        """Notes on facts of a new entity whose known end has a kind new to the relation's slot."""
        for head, relation, tail in facts:
            slot, end, role = (HEAD, head, "a head") if tail == new else (TAIL, tail, "a tail")
            kind = self.kinds[self.names.ids[end]] if end in self.names.ids else ""
            usual = self.kinds_in_slot(self.labels.ids[relation], slot)
            if kind and usual and kind not in usual:
                yield f"no known triple of {relation} has {role} of kind {kind}, as {end} is"

    @remembered
    def kinds_in_slot(self, relation: int, slot: int) -> set[str]:
        """The kinds of the entities in a slot of the known triples of a relation."""
        return {self.kinds[row] for row in self.in_slot(relation, slot)} - {""}

    @remembered
    def fitting_in_slot(self, relation: int, slot: int) -> np.ndarray:
        """The ids of the entities in a slot of the known triples of a relation that are candidates
        there, sorted.
        """
        in_slot = np.array(self.in_slot(relation, slot), np.int64)
        return in_slot[np.isin(in_slot, self.candidates(relation, slot))]

    def kind_of(self, new: str, facts: Iterable[Fact], alike: np.ndarray | None) -> tuple[str, str]:
        """The kind of a new entity and the reason; empty texts if unknown.
        ``alike``: cosines of its words, (E,).

        Each fact counts for the kind of the most similar known entity in the same slot of its
        relation (without words: for all kinds there, by their shares), if this kind is usual there.
        Without facts, all known entities count, similar ones most. Entities without a kind count,
        too: where they win, the new one has none.
        """
        votes, roles = np.zeros(1 + len(self.kind_numbers)), dict[str, None]()
        for head, relation, _ in facts:
            slot, role = (HEAD, "heads") if head == new else (TAIL, "tails")
            there = self.fitting_in_slot(self.labels.ids[relation], slot)
            if len(there):
                listed = there if alike is None else there[[alike[there].argmax()]]
                votes += self._of_kinds(listed, np.full(len(listed), 1 / len(listed)))
                roles[f"the {role} of {relation}"] = None
        like = " and ".join(roles)
        if not roles and alike is not None:
            votes = self._of_kinds(np.arange(len(alike)), np.exp(alike / TEMPERATURE))
            of_kind = np.flatnonzero(self.kind_ids + 1 == votes.argmax())
            like = self.entity_names[of_kind[alike[of_kind].argmax()]]
        kind = ["", *self.kind_numbers][int(votes.argmax())]
        return (kind, f"{new} counts as {kind}, like {like}") if kind else ("", "")

    def _of_kinds(self, entities: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The total weight of entities, (N,), without a kind and of each kind;
        ``entities``: ids.
        """
        return np.bincount(self.kind_ids[entities] + 1, weights, 1 + len(self.kind_numbers))

    def named(self, query: Query) -> tuple[str, str, str]:
        """A query as names, with a question mark for the answer."""
        given, relation = self.entity_names[query.given], self.relation_names[query.relation]
        return (given, relation, "?") if query.slot == TAIL else ("?", relation, given)


def distinct(numbers: np.ndarray) -> np.ndarray:
    """The distinct numbers, (N,), sorted, as ``np.unique``, which loads masked arrays for 20 ms."""
    ordered = np.sort(numbers)
    return ordered[np.diff(ordered, prepend=ordered[:1] - 1) > 0]


def best_first(scores: np.ndarray) -> np.ndarray:
    """The places of scores, (N,), the highest first; equal ones stay in order."""
    return np.argsort(-scores, kind="stable")


def answers_in(triples: np.ndarray, query: Query) -> set[int]:
    """The answers of a query in triples of ids, (T, 3)."""
    other = HEAD + TAIL - query.slot
    of_query = (triples[:, other] == query.given) & (triples[:, RELATION] == query.relation)
    return set(triples[of_query, query.slot].tolist())
