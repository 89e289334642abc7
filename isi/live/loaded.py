"""Queries to a bundle: scores, known answers, candidates, nearest entities,
and lookup of typed names.
"""

from collections import ChainMap, Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.errors import InputError, at, short
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.arguments import Names, checked_model, listed_triples, stack_of_one, table
from isi.live.folder import MANIFEST, VECTORS, Bundle, read
from isi.live.names import KnownNames
from isi.models.model import Model
from isi.models.stack import Embedding

#: A query fits an entity if more than this share of its indicators, by weight, have known answers.
ENOUGH = 0.1
USUAL = 0.1  #: Share of entities for which a kind is usual in a slot.
#: Without facts, a known entity counts for the kind of a new one with the weight exp(cosine of the
#: words / this).
TEMPERATURE = 0.07
MOST_QUERIES = 24  #: Maximum number of queries about one entity.


Fact = tuple[str, str, str]  #: Head, relation and tail by name.


class Query(NamedTuple):
    """A query by ids: (given, relation, ?) if the slot is ``TAIL``,
    (?, relation, given) if it is ``HEAD``.
    """

    given: int
    relation: int
    slot: int


@dataclass(frozen=True, eq=False)
class LoadedEmbedding(Bundle):
    """A bundle with its scoring function."""

    scoring: Model | None = None  #: None: the model that the manifest names
    #: facts that no longer hold, and are no answers; ids, shape: (K, 3)
    retracted: np.ndarray = field(default_factory=partial(np.zeros, (0, 3), np.int64))

    #: of ``kinded_in_slot``, by relation and slot
    _kinded: dict[tuple[int, int], np.ndarray] = field(init=False, default_factory=dict)

    @cached_property
    def model(self) -> Model:
        return self.scoring or checked_model(
            self.manifest.model_name, self.manifest.model_options, self.entities.shape[1]
        )

    @cached_property
    def embedding(self) -> Embedding:
        """The tables as a stack of one embedding in single precision."""
        relations = table(self.relations, "relations", self.model.width(self.entities.shape[1]))
        return stack_of_one(self.entities, relations, self.model)

    @cached_property
    def entity_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.entity_names)}

    @cached_property
    def relation_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.relation_names)}

    @cached_property
    def known_entities(self) -> KnownNames:
        return KnownNames(self.entity_ids)

    @cached_property
    def known_relations(self) -> KnownNames:
        return KnownNames(self.relation_ids)

    @cached_property
    def names(self) -> Names:
        return Names("entity_names", len(self.entities), self.entity_names)

    @cached_property
    def labels(self) -> Names:
        return Names("relation_names", len(self.relations), self.relation_names)

    def answers(self, query: Query) -> set[int]:
        """The known answers of a query."""
        return answers_in(self.triples, query)

    def ids_of(self, facts: Iterable[Fact]) -> np.ndarray:
        """Facts by name as ids, shape (F, 3), int64."""
        ids, labels = self.entity_ids, self.relation_ids
        rows = [(ids[head], labels[relation], ids[tail]) for head, relation, tail in facts]
        return np.array(rows, np.int64).reshape(-1, 3)

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

    def scores(self, given: Tensor, relation: int, slot: int) -> Tensor:
        """Scores of all entities in the slot, (Q, E), for given entities, (Q,), and a relation."""
        relations = torch.full_like(given, relation)[None]
        if slot == TAIL:
            return self.embedding.score_tails(given[None], relations)[0]
        return self.embedding.score_heads(relations, given[None])[0]

    def in_slot(self, relation: int, slot: int) -> list[int]:
        """The ids of the entities in a slot of the known triples of a relation, sorted."""
        return np.unique(self.triples[self.triples[:, RELATION] == relation, slot]).tolist()  # type: ignore[no-any-return]

    @cached_property
    def kind_numbers(self) -> dict[str, int]:
        return {kind: number for number, kind in enumerate(dict.fromkeys(filter(None, self.kinds)))}

    @cached_property
    def kind_ids(self) -> np.ndarray:
        """A number for each entity's kind, (E,); -1 without a kind."""
        return np.array([self.kind_numbers.get(kind, -1) for kind in self.kinds])

    def candidates(self, relation: int, slot: int) -> Tensor:
        """Ids of entities without a kind, or of a usual kind in this slot of known triples;
        all if it has no kinds.

        Usual is a kind that at least two entities, or a tenth of those in the other slot, have in
        their triples.
        """
        triples = self.triples[self.triples[:, RELATION] == relation]
        others, kinds = triples[:, HEAD + TAIL - slot], self.kind_ids[triples[:, slot]]
        pairs = np.unique(kinds[kinds >= 0] * len(self.entities) + others[kinds >= 0]) // len(
            self.entities
        )
        usual, support = np.unique(pairs, return_counts=True)
        usual = usual[(support > 1) | (support >= USUAL * len(np.unique(others)))]
        fits = (
            (self.kind_ids < 0) | np.isin(self.kind_ids, usual)
            if len(pairs)
            else np.full(len(self.kinds), True)
        )
        return torch.from_numpy(np.flatnonzero(fits))

    def ranked(self, query: Query) -> tuple[Tensor, Tensor]:
        """Candidates and known answers, best first, and scores, without retracted answers.

        The given entity is excluded unless it is an answer.
        """
        fitting = set(self.candidates(query.relation, query.slot).tolist()) - {query.given}
        listed = (fitting | self.answers(query)) - answers_in(self.retracted, query)
        candidates = torch.tensor(sorted(listed), dtype=torch.int64)
        scores = self.scores(torch.tensor([query.given]), query.relation, query.slot)[0, candidates]
        best = scores.sort(descending=True, stable=True)
        return candidates[best.indices], best.values

    def nearest(self, entity: int, number: int) -> list[tuple[int, float]]:
        """The ``number`` other entities with the highest cosine to ``entity``,
        and these cosines, best first.
        """
        vectors = normalize(self.embedding.entity[0], dim=-1)
        cosines = (vectors @ vectors[entity]).index_fill(0, torch.tensor(entity), -torch.inf)
        best = cosines.sort(descending=True, stable=True)
        shown = min(number, len(cosines) - 1)
        return list(zip(best.indices[:shown].tolist(), best.values[:shown].tolist(), strict=True))

    def kind_notes(self, facts: Iterable[Fact], new: str) -> Iterator[str]:
        """Notes on facts of a new entity whose known end has a kind new to the relation's slot."""
        for head, relation, tail in facts:
            slot, end, role = (HEAD, head, "a head") if tail == new else (TAIL, tail, "a tail")
            kind = self.kinds[self.entity_ids[end]] if end in self.entity_ids else ""
            usual = self.kinds_in_slot(self.relation_ids[relation], slot)
            if kind and usual and kind not in usual:
                yield f"no known triple of {relation} has {role} of kind {kind}, as {end} is"

    @cached_property
    def kinds_in_slot(self) -> Callable[[int, int], Counter[str]]:
        """The number of entities of each kind in a slot of the known triples of a relation."""

        @cache
        def count(relation: int, slot: int) -> Counter[str]:
            return Counter(filter(None, (self.kinds[row] for row in self.in_slot(relation, slot))))

        return count

    def kinded_in_slot(self, relation: int, slot: int) -> np.ndarray:
        """The ids of the entities in a slot of the known triples of a relation whose kind is usual
        there, sorted.
        """
        if (relation, slot) not in self._kinded:
            usual = self.candidates(relation, slot).numpy()
            in_slot = np.array(self.in_slot(relation, slot), np.int64)
            has_kind = self.kind_ids[in_slot] >= 0
            self._kinded[relation, slot] = in_slot[has_kind & np.isin(in_slot, usual)]
        return self._kinded[relation, slot]

    def kind_of(self, new: str, facts: Iterable[Fact], alike: np.ndarray | None) -> tuple[str, str]:
        """The kind of a new entity and the reason; empty texts if unknown.
        ``alike``: cosines of its words, (E,).

        Each fact counts for the kind of the most similar known entity in the same slot of its
        relation (without words: for all kinds there, by their shares), if this kind is usual there.
        Without facts, all known entities count, similar ones most.
        """
        votes, roles = np.zeros(len(self.kind_numbers)), dict[str, None]()
        for head, relation, _ in facts:
            slot, role = (HEAD, "heads") if head == new else (TAIL, "tails")
            there = self.kinded_in_slot(self.relation_ids[relation], slot)
            if len(there):
                listed = there if alike is None else there[[alike[there].argmax()]]
                votes += self._of_kinds(listed, np.full(len(listed), 1 / len(listed)))
                roles[f"the {role} of {relation}"] = None
        like = " and ".join(roles)
        if not roles and alike is not None:
            listed = np.flatnonzero(self.kind_ids >= 0)
            votes = self._of_kinds(listed, np.exp(alike[listed] / TEMPERATURE))
            if len(listed):
                of_kind = listed[self.kind_ids[listed] == votes.argmax()]
                like = self.entity_names[of_kind[alike[of_kind].argmax()]]
        if not like:
            return "", ""
        kind = list(self.kind_numbers)[int(votes.argmax())]
        return kind, f"{new} counts as {kind}, like {like}"

    def _of_kinds(self, entities: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The total weight of entities, (N,), of each kind; ``entities``: ids."""
        return np.bincount(self.kind_ids[entities], weights, len(self.kind_numbers))

    def facts(self, facts: Any, new: Sequence[str] = ()) -> list[Fact]:
        """Facts in any form of ``listed_triples``, by name and once each;
        InputError for a name that is unknown.
        """
        entities = KnownNames(ChainMap(dict.fromkeys(new, -1), self.entity_ids))
        listed = dict[Fact, None]()
        for head, relation, tail in as_facts(facts):
            place = f"{head} {relation} {tail}"[:80]
            ends = [entities.find(end, place, "an entity") for end in (head, tail)]
            label = self.known_relations.find(relation, place, "a relation")
            listed[ends[0], label, ends[1]] = None
        return list(listed)

    def unknown(self, facts: Iterable[Fact]) -> list[Fact]:
        """Those of the facts that are no known triples."""
        ids, labels = self.entity_ids, self.relation_ids
        return [
            (head, relation, tail)
            for head, relation, tail in facts
            if not {head, tail} <= ids.keys()
            or ids[tail] not in self.answers(Query(ids[head], labels[relation], TAIL))
        ]

    def named(self, query: Query) -> tuple[str, str, str]:
        """A query as names, with a question mark for the answer."""
        given, relation = self.entity_names[query.given], self.relation_names[query.relation]
        return (given, relation, "?") if query.slot == TAIL else ("?", relation, given)

    def part(self, rows: np.ndarray) -> Self:
        """The bundle restricted to the entities ``rows`` (ids), in this order,
        and the triples between them.
        """
        new_id = np.full(len(self.entities), -1)
        new_id[rows] = np.arange(len(rows))
        triples = self.triples.copy()
        triples[:, [HEAD, TAIL]] = new_id[self.triples[:, [HEAD, TAIL]]]
        texts = self.entity_names, self.kinds, self.phrases
        names, kinds, phrases = ([listed[row] for row in rows] for listed in texts)
        inserted = [record for record in self.manifest.inserted if record.entity in set(names)]
        return replace(
            self,
            manifest=self.manifest.model_copy(update={"inserted": inserted}),
            entities=self.entities[rows],
            entity_names=names,
            kinds=kinds,
            phrases=phrases,
            triples=triples[(triples >= 0).all(1)],
            retracted=np.zeros((0, 3), np.int64),
            words=None if self.words is None else self.words[rows],
        )


def as_facts(facts: Any) -> list[Fact]:
    """Facts in any form of ``listed_triples`` as typed;
    an ``InputError`` refuses what is not three texts.
    """
    listed = list[Fact]()
    for number, fact in enumerate(listed_triples(facts)):
        whole = isinstance(fact, list | tuple | np.ndarray) and len(fact) == 3
        if not (whole and all(isinstance(part, str) for part in fact)):
            expected = "expected head, relation and tail by name"
            raise InputError(f"fact {number}", "", f"{expected}, got {short(fact)}")
        head, relation, tail = fact
        listed.append((head, relation, tail))
    return listed


def answers_in(triples: np.ndarray, query: Query) -> set[int]:
    """The answers of a query in triples of ids, (T, 3)."""
    other = HEAD + TAIL - query.slot
    of_query = (triples[:, other] == query.given) & (triples[:, RELATION] == query.relation)
    return set(triples[of_query, query.slot].tolist())


def open_bundle(folder: Path) -> LoadedEmbedding:
    """Read the bundle of a folder. An ``InputError`` refuses a broken one,
    or tables that do not fit the model.
    """
    opened = LoadedEmbedding(**vars(read(folder)))
    with at(folder / MANIFEST, "family"):
        opened.model  # noqa: B018  # checks the manifest
    with at(folder / VECTORS):
        opened.embedding  # noqa: B018
    return opened


def queries_of(
    opened: LoadedEmbedding, entity: int, indicators: Mapping[int, float]
) -> list[Query]:
    """The queries that fit an entity: relations and slots in which it or enough similar
    entities have known answers.

    Similar are entities of its kind, or, if it has no kind, its ``indicators`` (weights by id). If
    no query fits, all do. At most ``MOST_QUERIES`` are returned: those with own answers, then with
    most similar entities (or weight).
    """
    kind, weights, enough = opened.kind_ids[entity], np.zeros(len(opened.entities)), 0.0
    weights[opened.kind_ids == kind] = 1.0
    if kind < 0:
        weights[:] = 0.0
        weights[list(indicators)] = list(indicators.values())
        enough = ENOUGH * weights.sum()
    of_query = {}
    for relation in range(len(opened.relations)):
        for slot in (TAIL, HEAD):
            similar = opened.in_slot(relation, HEAD + TAIL - slot)
            of_query[Query(entity, relation, slot)] = (
                float("inf") if entity in similar else weights[similar].sum()
            )
    fit = [query for query, weight in of_query.items() if weight > enough] or list(of_query)
    best = sorted(fit, key=of_query.__getitem__, reverse=True)[:MOST_QUERIES]
    return [query for query in fit if query in best]
