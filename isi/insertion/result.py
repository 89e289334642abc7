"""What ``isi.insert`` returns: enlarged tables, a report of each new entity, interference with known answers."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.config import Count, Seed, check
from isi.errors import InputError
from isi.evaluation.ranking import compare, make_queries, padded_ids, rank_queries
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.arguments import Names, Triple, stack_of_one, trained_session, triples_of
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.models.stack import rows as rows_of
from isi.random import stream

BUDGET = 2**24  #: Numbers in a table of cosines, at most.
SAME = 1e-6  #: Of the largest deviation of a coordinate: known vectors that differ by less count as equal in it.
CLOUD = 2**16  #: Known vectors from which the spread is taken, at most, evenly over the table.


@dataclass(frozen=True)
class Entity:
    """The report of a new entity."""

    name: str | int
    id: int
    insert_triples: int  #: triples with a known end, which the initializer saw
    between: int  #: triples between two new ones, which it did not
    fallback: str | None  #: what replaced the initializer where data were missing: es, rs, centroid
    indicators: list[str | int] | None  #: whose centroid was taken, if one was
    nearest: list[tuple[str | int, float]]  #: the known entities of nearest vectors, with their cosines
    #: root mean square, over coordinates, of the z-score among known vectors; 1 is usual
    distance: float
    farther_than: float  #: share of the known that lie nearer to the centre


@dataclass(frozen=True)
class Interference:
    """Effect of new entities on ranks of known answers. Each triple gives two queries, for its head and its tail."""

    queries: int
    #: of each new entity, the share of queries in which it ranks above the known answer (½ where they are tied);
    #: where an insert triple makes it an answer itself, it counts as below
    above: list[float]
    #: filtered mean reciprocal rank and mean rank of the known answers, among known entities and among all
    mrr_before: float
    mrr_after: float
    rank_before: float
    rank_after: float


@dataclass(frozen=True, eq=False)
class Inserted:
    """An embedding with new entities in it. The rows of known entities are the bytes that were given."""

    entities: np.ndarray  #: shape: (E + n, d)
    relations: np.ndarray  #: shape: (R, w)
    model: Model
    entity_names: Sequence[str] | None  #: null where they go by id
    relation_names: Sequence[str] | None
    new: list[int]  #: ids of the new entities
    insert_triples: np.ndarray  #: triples with one new end; shape: (I, 3)
    between: np.ndarray  #: and with two; shape: (B, 3)
    known_triples: np.ndarray
    initializer: str
    options: Mapping[str, Any]
    why: str  #: why this initializer
    fallback: list[str | None]  #: what served each new entity where the initializer could not: es, rs, centroid
    #: what each known entity weighs in each new vector, or in the mean of its prior; shape (n, E); null where the
    #: initializer has no weights, or where they are too many
    weights: np.ndarray | None
    indicators: list[list[int]] | None  #: ids of the indicators of each, where the initializer has them

    @property
    def known(self) -> int:
        """Number of known entities, whose ids come first."""
        return self.new[0]

    @cached_property
    def embedding(self) -> Embedding:
        """The tables as a stack of one embedding in single precision."""
        return stack_of_one(self.entities, self.relations, self.model)

    @cached_property
    def names(self) -> Names:
        return Names("entity_names", len(self.entities), self.entity_names)

    def report(self, nearest: int = 5) -> list[Entity]:
        """What became of each new entity, with so many of its ``nearest`` known entities."""
        check(nearest, Seed, "", "argument 'nearest'")
        of, vectors = self.names.of, self.embedding.entity[0]
        inserted, between = (
            Counter(end for head, _, tail in triples.tolist() for end in {head, tail})
            for triples in (self.insert_triples, self.between)
        )
        known = normalize(vectors[: self.known], dim=-1)
        parts = torch.split(vectors[self.known :], max(1, BUDGET // self.known))
        best = [torch.topk(normalize(part, dim=-1) @ known.T, min(nearest, self.known)) for part in parts]
        cosines, ids = (torch.cat([part[place] for part in best]).tolist() for place in (0, 1))
        distances, shares = self._from_cloud()
        return [
            Entity(
                of(row), row, inserted[row], between[row], self.fallback[place],
                None if self.indicators is None else list(map(of, self.indicators[place])),
                list(zip(map(of, ids[place]), cosines[place], strict=True)), distances[place], shares[place],
            )
            for place, row in enumerate(self.new)
        ]  # fmt: skip

    def _from_cloud(self) -> tuple[list[float], list[float]]:
        """Distances, and shares of known vectors that lie nearer. Coordinates in which all are equal do not count."""
        vectors = self.embedding.entity[0]
        known = vectors[: self.known : max(1, -(-self.known // CLOUD))].double()
        centre, deviation = known.mean(0), known.std(0, correction=0)
        alive = deviation > SAME * deviation.max()

        def distance(of: Tensor) -> Tensor:
            return ((of.double() - centre) / deviation)[:, alive].square().sum(-1).div(max(1, int(alive.sum()))).sqrt()

        usual, new = distance(known).sort().values, distance(vectors[self.known :])
        return new.tolist(), (torch.searchsorted(usual, new) / len(usual)).tolist()

    def interference(
        self, triples: Sequence[Triple] | np.ndarray | None = None, most: int = 256, seed: int = 0
    ) -> Interference:
        """How often new entities rank above known answers, and what that does to their ranks.

        Args:
            triples: of known entities, held out or not; ``known_triples`` where there are none.
            most: triples that are queried; drawn where there are more.
            seed: of the draw.
        """
        check(seed, Seed, "", "argument 'seed'")
        check(most, Count, "", "argument 'most'")
        labels = Names("relation_names", len(self.relations), self.relation_names)
        queried = self.known_triples if triples is None else triples_of(triples, "triples", self.names, labels)
        if not len(queried) or (queried[:, [HEAD, TAIL]] >= self.known).any():
            raise InputError("argument 'triples'", "", "expected triples of known entities, which give the queries")
        if len(queried) > most:
            queried = queried[np.sort(stream(seed, "interference").permutation(len(queried))[:most])]
        right = np.concatenate([queried, self.insert_triples, self.known_triples])
        before, after = _ranks(self.embedding, queried, right, self.known)
        above = ranked_above(self.embedding, self.known, *map(torch.from_numpy, (queried, self.insert_triples)))
        return Interference(
            2 * len(queried), above.tolist(),
            (1 / before).mean().item(), (1 / after).mean().item(), before.mean().item(), after.mean().item(),
        )  # fmt: skip


def ranked_above(embedding: Embedding, known: int, queried: Tensor, insert_triples: Tensor) -> Tensor:
    """Share of all queries, (n,), in which each new entity, unless an answer itself, ranks above the answer."""
    head, relation, tail = queried.T[:, None]  # (1, Q)
    relations, new = rows_of(embedding.relation, relation), embedding.entity[:, known:]
    model, heads, tails = embedding.model, rows_of(embedding.entity, head), rows_of(embedding.entity, tail)
    answer = model.score(heads, relations, tails)[..., None]
    total = torch.zeros(new.shape[1], dtype=torch.float64)
    for scores, end, slot in (
        (model.score_tails(heads, relations, new), HEAD, TAIL), (model.score_heads(tails, relations, new), TAIL, HEAD)
    ):  # fmt: skip
        above = compare(torch.cat([answer, scores], -1), torch.zeros_like(head))[0, :, 1:]
        in_slot = insert_triples[insert_triples[:, slot] >= known]
        same = (queried[:, None, [end, RELATION]] == in_slot[:, [end, RELATION]]).all(-1)
        query, triple = same.nonzero(as_tuple=True)
        above[query, in_slot[triple, slot] - known] = 0
        total += above.double().sum(0)
    return total / (2 * len(queried))


def _ranks(embedding: Embedding, queried: np.ndarray, right: np.ndarray, known: int) -> list[Tensor]:
    """Filtered ranks, (2Q,), among known entities and among all. ``right``, (T, 3), begins with ``queried``."""
    triples, place = np.unique(right, axis=0, return_inverse=True)
    session = trained_session(triples, embedding)
    is_queried = torch.zeros(1, len(triples), dtype=torch.bool)
    is_queried[:, torch.from_numpy(place.flatten()[: len(queried)])] = True
    slots, filtered = padded_ids(is_queried), torch.ones_like(is_queried)
    known_alone = torch.arange(session.entities.shape[1])[None] < known
    queries = {
        name: make_queries(session, slots, is_queried, filtered, candidates)
        for name, candidates in (("before", known_alone), ("after", session.entities))
    }
    pieces = list(rank_queries(embedding, queries))
    return [
        torch.cat([piece[name].slots[slot].rank[0] for piece in pieces for slot in (HEAD, TAIL)]).double()
        for name in queries
    ]
