"""The result of ``isi.insert``: enlarged tables, a report of each new entity, interference with known answers."""

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

BUDGET = 2**24  #: Maximum number of cosines in one table.
SAME = 1e-6  #: A coordinate whose deviation is below this share of the largest one is ignored.
CLOUD = 2**16  #: Maximum number of known vectors, evenly spaced by id, that define centre and deviation.


@dataclass(frozen=True)
class Entity:
    """The report of a new entity."""

    name: str | int
    id: int
    insert_triples: int  #: number of triples with a known end, which the initializer may use
    between: int  #: number of triples whose ends are all new, which the initializer did not use
    fallback: str | None  #: the rule that replaced the initializer for lack of data: es, rs, centroid; or null
    indicators: list[str | int] | None  #: the entities whose centroid is the vector; null if it is no centroid
    nearest: list[tuple[str | int, float]]  #: known entities with the highest cosines, and the cosines
    #: root mean square over coordinates of the z-score (mean and deviation of known vectors); 1 is typical
    distance: float
    farther_than: float  #: share of known vectors with a smaller distance


@dataclass(frozen=True)
class Interference:
    """Effect of new entities on the ranks of known answers. Each queried triple gives a head and a tail query."""

    queries: int
    #: for each new entity, the share of queries in which it scores above the known answer; a tie counts ½; queries
    #: that it answers itself by an insert triple count 0
    above: list[float]
    #: filtered MRR and mean rank of known answers, among known entities (before) and among all (after)
    mrr_before: float
    mrr_after: float
    rank_before: float
    rank_after: float


@dataclass(frozen=True, eq=False)
class Inserted:
    """An embedding with new entities. The rows of known entities are unchanged."""

    entities: np.ndarray  #: shape: (E + n, d)
    relations: np.ndarray  #: shape: (R, w)
    model: Model
    entity_names: Sequence[str] | None  #: null if entities have ids only
    relation_names: Sequence[str] | None
    new: list[int]  #: ids of the new entities
    insert_triples: np.ndarray  #: triples of a new and a known entity; shape: (I, 3)
    between: np.ndarray  #: triples of new entities only; shape: (B, 3)
    known_triples: np.ndarray
    initializer: str
    options: Mapping[str, Any]
    why: str  #: the reason for this initializer
    fallback: list[str | None]  #: for each new entity, the rule that replaced the initializer: es, rs, centroid or null
    #: weights of known entities in each new vector (MAP, ridge: in the prior's mean); shape (n, E); null if the
    #: initializer has no weights, or n · E is too large
    weights: np.ndarray | None
    indicators: list[list[int]] | None  #: ids of the indicators of each new entity; null if vectors are no centroids

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
        """The report of each new entity; ``nearest``: the number of nearest known entities in it."""
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
        """``distance`` and ``farther_than`` of each new entity. Coordinates with (almost) no deviation are ignored."""
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
        """Measure how often new entities rank above known answers, and the MRR of these answers before and after.

        Args:
            triples: of known entities, to query, held out or trained; null: ``known_triples``. InputError if none.
            most: maximum number of queried triples; a larger set is sampled at random.
            seed: root seed of the sample.
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
    """For each new entity, (n,), the share of queries in which it ranks above the answer (``Interference.above``)."""
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
    """Filtered ranks, (2Q,), among known and among all entities. ``right``, (T, 3): true triples, ``queried`` first."""
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
