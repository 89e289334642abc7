"""Queries to a bundle: scores, known answers, candidates, nearest entities, and lookup of typed names."""

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.bundle.folder import MANIFEST, VECTORS, Bundle, read
from isi.errors import InputError, at
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.arguments import checked_model, stack_of_one, table
from isi.models.model import Model
from isi.models.stack import Embedding

ENOUGH = 0.1  #: A query fits an entity if more than this share of its indicators, by weight, have known answers.
MOST_QUERIES = 24  #: Maximum number of queries about one entity.
SUGGESTED, LISTED = 3, 8  #: Maximum number of names that a message suggests: similar ones; ``same_name`` or all names.


class Query(NamedTuple):
    """A query by ids: (given, relation, ?) if the slot is ``TAIL``, (?, relation, given) if it is ``HEAD``."""

    given: int
    relation: int
    slot: int


@dataclass(frozen=True, eq=False)
class OpenBundle(Bundle):
    """A bundle with its scoring function."""

    @cached_property
    def model(self) -> Model:
        return checked_model(self.manifest.model_name, self.manifest.model_options, self.entities.shape[1])

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
    def answers(self) -> dict[Query, set[int]]:
        """The known answers of each query that has any."""
        answers: dict[Query, set[int]] = defaultdict(set)
        for head, relation, tail in self.triples.tolist():
            answers[Query(head, relation, TAIL)].add(tail)
            answers[Query(tail, relation, HEAD)].add(head)
        return dict(answers)

    def scores(self, given: Tensor, relation: int, slot: int) -> Tensor:
        """Scores of all entities in the slot, (Q, E), for given entities, (Q,), and a relation."""
        relations = torch.full_like(given, relation)[None]
        if slot == TAIL:
            return self.embedding.score_tails(given[None], relations)[0]
        return self.embedding.score_heads(relations, given[None])[0]

    def in_slot(self, relation: int, slot: int) -> list[int]:
        """The ids of the entities in a slot of the known triples of a relation, sorted."""
        return sorted(set(self.triples[self.triples[:, RELATION] == relation, slot].tolist()))

    def candidates(self, relation: int, slot: int) -> Tensor:
        """Ids of entities without a kind, or of a kind in this slot of known triples; all if the slot has no kinds."""
        kinds = {self.kinds[row] for row in self.in_slot(relation, slot)} - {""}
        return torch.tensor([row for row, kind in enumerate(self.kinds) if not (kind and kinds) or kind in kinds])

    def ranked(self, query: Query) -> tuple[Tensor, Tensor]:
        """The candidates, best first, and their scores. The given entity is excluded unless it is a known answer."""
        candidates = self.candidates(query.relation, query.slot)
        if query.given not in self.answers.get(query, ()):
            candidates = candidates[candidates != query.given]
        scores = self.scores(torch.tensor([query.given]), query.relation, query.slot)[0, candidates]
        best = scores.sort(descending=True, stable=True)
        return candidates[best.indices], best.values

    def nearest(self, entity: int, number: int) -> list[tuple[int, float]]:
        """The ``number`` other entities with the highest cosine to ``entity``, and these cosines, best first."""
        vectors = normalize(self.embedding.entity[0], dim=-1)
        cosines = (vectors @ vectors[entity]).index_fill(0, torch.tensor(entity), -torch.inf)
        best = cosines.sort(descending=True, stable=True)
        shown = min(number, len(cosines) - 1)
        return list(zip(best.indices[:shown].tolist(), best.values[:shown].tolist(), strict=True))

    def kind_notes(self, insert_triples: Iterable[tuple[str, str, str]]) -> Iterator[str]:
        """Notes on insert triples whose known end has a kind new to the relation's slot; none if kinds are missing."""
        for head, relation, tail in dict.fromkeys(insert_triples):
            slot, end, role = (HEAD, head, "a head") if head in self.entity_ids else (TAIL, tail, "a tail")
            kind = self.kinds[self.entity_ids[end]]
            usual = {self.kinds[row] for row in self.in_slot(self.relation_ids[relation], slot)}
            if kind and usual and not {"", kind} & usual:
                yield f"no known triple of {relation} has {role} of kind {kind}, as {end} is"

    def named(self, query: Query) -> tuple[str, str, str]:
        """A query as names, with a question mark for the answer."""
        given, relation = self.entity_names[query.given], self.relation_names[query.relation]
        return (given, relation, "?") if query.slot == TAIL else ("?", relation, given)

    def part(self, rows: np.ndarray) -> Self:
        """The bundle restricted to the entities ``rows`` (ids), in this order, and the triples between them."""
        new_id = np.full(len(self.entities), -1)
        new_id[rows] = np.arange(len(rows))
        triples = self.triples.copy()
        triples[:, [HEAD, TAIL]] = new_id[self.triples[:, [HEAD, TAIL]]]
        texts = self.entity_names, self.kinds, self.phrases
        names, kinds, phrases = ([listed[row] for row in rows] for listed in texts)
        inserted = [record for record in self.manifest.inserted if record.entity in set(names)]
        return replace(
            self, manifest=self.manifest.model_copy(update={"inserted": inserted}), entities=self.entities[rows],
            entity_names=names, kinds=kinds, phrases=phrases, triples=triples[(triples >= 0).all(1)],
            words=None if self.words is None else self.words[rows],
        )  # fmt: skip


def open_bundle(folder: Path) -> OpenBundle:
    """Read the bundle of a folder. An ``InputError`` refuses a broken one, or tables that do not fit the model."""
    opened = OpenBundle(**vars(read(folder)))
    with at(folder / MANIFEST, "family"):
        opened.model  # noqa: B018  # checks the manifest
    with at(folder / VECTORS):
        opened.embedding  # noqa: B018
    return opened


def queries_of(opened: OpenBundle, entity: int, indicators: Mapping[int, float]) -> list[Query]:
    """The queries that fit an entity: relations and slots in which it or enough similar entities have known answers.

    Similar are entities of its kind, or, if it has no kind, its ``indicators`` (weights by id). If no query fits, all
    do. At most ``MOST_QUERIES`` are returned: those with own answers, then with most similar entities (or weight).
    """
    kind, enough = opened.kinds[entity], 0.0
    similar: Mapping[int, float] = {row: 1.0 for row, other in enumerate(opened.kinds) if other == kind}
    if not kind:
        similar, enough = indicators, ENOUGH * sum(indicators.values())

    def weight(query: Query) -> float:
        if query in opened.answers:
            return float("inf")
        return sum(share for row, share in similar.items() if query._replace(given=row) in opened.answers)

    queries = [Query(entity, relation, slot) for relation in range(len(opened.relations)) for slot in (TAIL, HEAD)]
    weights = {query: weight(query) for query in queries}
    fit = [query for query in queries if weights[query] > enough] or queries
    best = sorted(fit, key=weights.__getitem__, reverse=True)[:MOST_QUERIES]
    return [query for query in fit if query in best]


def plain(name: str) -> str:
    """A name as lower-case words: ``hasAffordance`` and ``has_affordance`` → ``has affordance``."""
    return " ".join(re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[_-]", " ", name).split()).casefold()


def same_name(first: str, second: str) -> bool:
    """Whether two names are equal up to case, spaces, hyphens and underscores."""
    return plain(first).replace(" ", "") == plain(second).replace(" ", "")


def find(text: str, names: Collection[str], place: str, expected: str) -> str:
    """The name that equals a text, or else the only ``same_name``; an ``InputError`` suggests similar names."""
    same = [text] if text in names else [name for name in names if same_name(name, text)]
    if len(same) == 1:
        return same[0]
    wanted, by_plain = plain(text), {plain(name): name for name in names}
    near = get_close_matches(wanted, by_plain, SUGGESTED) or [name for name in by_plain if wanted and wanted in name]
    close = same[:LISTED] or [by_plain[name] for name in near[:SUGGESTED]] or list(names) * (len(names) <= LISTED)
    hint = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
    raise InputError(place, "", f"expected {expected} of this embedding, got {text!r:.80}{hint}")
