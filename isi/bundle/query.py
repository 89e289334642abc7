"""A bundle that is open for queries: scores, known answers, candidates, nearest entities, fitting queries."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.bundle.folder import MANIFEST, VECTORS
from isi.bundle.manifest import Bundle, text_fault
from isi.bundle.names import find
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.arguments import checked_model, stack_of_one, table
from isi.models.model import Model
from isi.models.stack import LARGEST, Embedding

#: Share of the similar entities that must stand in a slot for it to be queried.
ENOUGH = 0.1
#: Queries of one entity, at most.
MOST_QUERIES = 24


@dataclass(frozen=True)
class Query:
    """(given, relation, ?) where the slot is ``TAIL``, (?, relation, given) where it is ``HEAD``; ids."""

    given: int
    relation: int
    slot: int


@dataclass(frozen=True, eq=False)
class OpenBundle:
    """A bundle with its scoring function."""

    bundle: Bundle
    model: Model

    @cached_property
    def embedding(self) -> Embedding:
        """As a stack of one, in single precision."""
        return stack_of_one(self.bundle.entities, self.bundle.relations, self.model)

    @cached_property
    def entity_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.bundle.entity_names)}

    @cached_property
    def relation_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.bundle.relation_names)}

    def entity(self, text: str, place: str) -> int:
        """The id of an entity as a user types it."""
        return find(text, self.entity_ids, place, "an entity of this embedding")

    def relation(self, text: str, place: str) -> int:
        """The id of a relation as a user types it."""
        return find(text, self.relation_ids, place, "a relation of this embedding")

    @cached_property
    def answers(self) -> dict[tuple[int, int, int], set[int]]:
        """Known answers by (given entity, relation, slot of the answer)."""
        answers: dict[tuple[int, int, int], set[int]] = defaultdict(set)
        for head, relation, tail in self.bundle.triples.tolist():
            answers[head, relation, TAIL].add(tail)
            answers[tail, relation, HEAD].add(head)
        return dict(answers)

    def scores(self, given: Tensor, relation: int, slot: int) -> Tensor:
        """Scores of all entities in a slot, for each given entity; shapes (Q,), result (Q, E)."""
        relations = torch.full_like(given, relation)[None]
        if slot == TAIL:
            return self.embedding.score_tails(given[None], relations)[0]
        return self.embedding.score_heads(relations, given[None])[0]

    def candidates(self, relation: int, slot: int) -> Tensor:
        """Entities of the kinds that known triples of the relation have in the slot, or of no kind; ids.

        All entities, where no known triple has one with a kind there.
        """
        kinds = {self.bundle.kinds[row] for row in self.in_slot(relation, slot)} - {""}
        if not kinds:
            return torch.arange(len(self.bundle.entities))
        return torch.tensor([row for row, kind in enumerate(self.bundle.kinds) if not kind or kind in kinds])

    def in_slot(self, relation: int, slot: int) -> list[int]:
        """Entities that known triples of a relation have in a slot, by id."""
        triples = self.bundle.triples[self.bundle.triples[:, RELATION] == relation]
        return sorted(set(triples[:, slot].tolist()))

    def nearest(self, entity: int, number: int) -> list[tuple[int, float]]:
        """The entities of nearest vectors with their cosines, best first."""
        vectors = normalize(self.embedding.entity[0], dim=-1)
        cosines = (vectors @ vectors[entity]).index_fill(0, torch.tensor(entity), -torch.inf)
        best = cosines.sort(descending=True, stable=True)
        shown = min(number, len(cosines) - 1)
        return list(zip(best.indices[:shown].tolist(), best.values[:shown].tolist(), strict=True))

    def ranked(self, query: Query) -> tuple[Tensor, Tensor]:
        """The candidates, best first, and their scores; the given entity is one only where it is a known answer."""
        given, relation, slot = query.given, query.relation, query.slot
        scores, candidates = self.scores(torch.tensor([given]), relation, slot)[0], self.candidates(relation, slot)
        if given not in self.answers.get((given, relation, slot), ()):
            candidates = candidates[candidates != given]
        best = scores[candidates].sort(descending=True, stable=True)
        return candidates[best.indices], best.values

    def named(self, query: Query, answer: str = "?") -> tuple[str, str, str]:
        """A query as a triple of names, with an answer or a question mark."""
        given, relation = self.bundle.entity_names[query.given], self.bundle.relation_names[query.relation]
        return (given, relation, answer) if query.slot == TAIL else (answer, relation, given)


def queries_of(
    opened: OpenBundle, entity: int, indicators: Mapping[int, float], most: int = MOST_QUERIES
) -> list[Query]:
    """The queries that fit an entity: each relation and slot in which it, or enough similar entities, have answers.

    All relations and slots, where no answers are known of any of these. Of too many, those in which the entity itself
    has answers, then those of most similar entities.

    Args:
        indicators: weights by id; they are the similar entities where the entity's kind is unknown, else those of its
            kind are.
        most: queries, at most.
    """
    kinds = opened.bundle.kinds
    by_kind = {row: 1.0 for row, kind in enumerate(kinds) if kind == kinds[entity]} if kinds[entity] else None
    similar = indicators if by_kind is None else by_kind
    enough = ENOUGH * sum(similar.values()) if by_kind is None else 0

    def weight(query: Query) -> float:
        if (entity, query.relation, query.slot) in opened.answers:
            return float("inf")
        return sum(share for row, share in similar.items() if (row, query.relation, query.slot) in opened.answers)

    queries = [
        Query(entity, relation, slot) for relation in range(len(opened.bundle.relations)) for slot in (TAIL, HEAD)
    ]
    fit = [query for query in queries if weight(query) > enough] or queries
    best = sorted(fit, key=weight, reverse=True)[:most]
    return [query for query in fit if query in best]


def open_bundle(bundle: Bundle, folder: Path) -> OpenBundle:
    """A bundle, ready for queries.

    Raises:
        InputError: where its model is unknown, its tables are not of that model, its numbers are too large, or a text
            of its manifest has control characters.
    """
    _check_texts(folder / MANIFEST, bundle)
    check_numbers(folder / VECTORS, bundle)
    manifest = bundle.manifest
    try:
        model = checked_model(manifest.model_name, manifest.model_options, bundle.entities.shape[1])
    except InputError as error:
        raise InputError(folder / MANIFEST, "family", ": ".join(error.args[1:]).removeprefix(": ")) from error
    try:
        table(bundle.relations, "relations", model.width(bundle.entities.shape[1]))
    except InputError as error:
        raise InputError(folder / VECTORS, "tensor 'relations'", error.args[2]) from error
    return OpenBundle(bundle, model)


def check_numbers(path: Path, bundle: Bundle) -> None:
    """Refuse numbers so large that a score would overflow in single precision.

    Raises:
        InputError: naming the row, and ``path``, where they come from.
    """
    for name, rows in (("entities", bundle.entities), ("relations", bundle.relations)):
        largest = np.abs(rows).max(1)
        if largest.max() > LARGEST:
            row = int(largest.argmax())
            raise InputError(path, f"{name}: row {row}", f"expected numbers up to {LARGEST:g}, got {largest[row]:.3g}")


def _check_texts(path: Path, bundle: Bundle) -> None:
    """Refuse control characters in texts that are printed; names have none."""
    sections = [(f"inserted.{number}", record) for number, record in enumerate(bundle.manifest.inserted)]
    for place, section in [*sections, ("words", bundle.manifest.words)]:
        for key, text in section.model_dump(by_alias=True).items() if section else ():
            if isinstance(text, str) and (fault := text_fault(text)):
                raise InputError(path, f"{place}.{key}", fault)
