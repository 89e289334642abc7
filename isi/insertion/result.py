"""What ``isi.insert`` returns: the enlarged tables, and a report of each new entity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.config import Count, Seed, check
from isi.graph.graph import HEAD, TAIL
from isi.insertion.arguments import Names, Triple, stack_of_one, triples_of
from isi.insertion.interference import Interference, interference
from isi.models.model import Model
from isi.models.stack import Embedding

#: Numbers in a table of cosines, at most.
BUDGET = 2**24
#: Of the largest deviation of a coordinate: known vectors that differ by less count as equal in it.
SAME = 1e-6
#: Known vectors from which the spread is taken, at most, evenly over the table.
CLOUD = 2**16


@dataclass(frozen=True)
class Entity:
    """What became of a new entity."""

    name: str | int
    id: int
    #: triples with a known end, which the initializer saw, and triples between two new ones, which it did not
    insert_triples: int
    between: int
    #: what served where the initializer could not: es, rs, centroid
    fallback: str | None
    #: whose centroid was taken, if one was
    indicators: list[str | int] | None
    #: the known entities of nearest vectors, with their cosines
    nearest: list[tuple[str | int, float]]
    #: from the centre of the known cloud, coordinates in its deviations, root mean square: 1 is usual
    distance: float
    #: share of the known that lie nearer to the centre
    farther_than: float


@dataclass(frozen=True, eq=False)
class Inserted:
    """An embedding with new entities in it; rows of the known ones are the bytes that were given."""

    #: shapes: (E + n, d), (R, w)
    entities: np.ndarray
    relations: np.ndarray
    model: Model
    #: null where they go by id
    entity_names: Sequence[str] | None
    relation_names: Sequence[str] | None
    #: ids of the new entities
    new: list[int]
    #: triples with one new end, and with two; shapes: (I, 3), (B, 3)
    insert_triples: np.ndarray
    between: np.ndarray
    known_triples: np.ndarray
    initializer: str
    options: Mapping[str, Any]
    #: why this initializer
    why: str
    #: what served each new entity where the initializer could not: es, rs, centroid
    fallback: list[str | None]
    #: what each known entity weighs in each new vector, or in the mean of its prior; shape (n, E); null where the
    #: initializer has no weights, or where they are too many
    weights: np.ndarray | None
    #: ids of the indicators of each, where the initializer has them
    indicators: list[list[int]] | None

    @property
    def known(self) -> int:
        """Number of known entities, whose ids come first."""
        return self.new[0]

    @cached_property
    def embedding(self) -> Embedding:
        """As a stack of one, in single precision."""
        return stack_of_one(self.entities, self.relations, self.model)

    @property
    def names(self) -> Names:
        return Names("entity_names", len(self.entities), self.entity_names)

    def report(self, nearest: int = 5) -> list[Entity]:
        """What became of each new entity, with as many of the nearest known ones.

        Raises:
            InputError: where that is no number.
        """
        check(nearest, Seed, "", Path("argument 'nearest'"))
        inserted, between = (_ends(triples, len(self.entities)) for triples in (self.insert_triples, self.between))
        ids, cosines = self._nearest(min(nearest, self.known))
        distance, farther_than = self._from_cloud()
        of = self.names.of
        return [
            Entity(
                of(row), row, int(inserted[row]), int(between[row]), self.fallback[place],
                None if self.indicators is None else [of(indicator) for indicator in self.indicators[place]],
                [(of(other), cosine) for other, cosine in zip(ids[place], cosines[place], strict=True)],
                distance[place], farther_than[place],
            )
            for place, row in enumerate(self.new)
        ]  # fmt: skip

    def interference(
        self, triples: Sequence[Triple] | np.ndarray | None = None, most: int = 256, seed: int = 0
    ) -> Interference:
        """How often new entities rank above known answers, and what that does to their ranks.

        Args:
            triples: of known entities, held out or not; ``known_triples`` where there are none.
            most: triples that are queried; drawn where there are more.
            seed: of the draw.

        Raises:
            InputError: where there is none, or one is of an unknown entity or relation.
        """
        check(seed, Seed, "", Path("argument 'seed'"))
        check(most, Count, "", Path("argument 'most'"))
        labels = Names("relation_names", len(self.relations), self.relation_names)
        queried = self.known_triples if triples is None else triples_of(triples, "triples", self.names, labels)
        return interference(self.embedding, self.known, queried, self.insert_triples, self.known_triples, most, seed)

    def _nearest(self, number: int) -> tuple[list[list[int]], list[list[float]]]:
        vectors = self.embedding.entity[0]
        known = normalize(vectors[: self.known], dim=-1)
        ids, cosines = list[list[int]](), list[list[float]]()
        for part in torch.split(vectors[self.known :], max(1, BUDGET // self.known)):
            best = torch.topk(normalize(part, dim=-1) @ known.T, number)
            ids += best.indices.tolist()
            cosines += best.values.tolist()
        return ids, cosines

    def _from_cloud(self) -> tuple[list[float], list[float]]:
        """Distances, and the shares of the known that lie nearer; without coordinates in which all are the same."""
        vectors = self.embedding.entity[0]
        known = vectors[: self.known : max(1, -(-self.known // CLOUD))].double()
        centre, deviation = known.mean(0), known.std(0, correction=0)
        alive = deviation > SAME * deviation.max()

        def distance(of: Tensor) -> Tensor:
            return ((of.double() - centre) / deviation)[:, alive].square().sum(-1).div(max(1, int(alive.sum()))).sqrt()

        usual, new = distance(known).sort().values, distance(vectors[self.known :])
        return new.tolist(), (torch.searchsorted(usual, new) / len(usual)).tolist()


def _ends(triples: np.ndarray, entities: int) -> np.ndarray:
    """Of how many triples each entity is an end; shape (E,)."""
    ends = triples[:, [HEAD, TAIL]]
    twice = ends[:, 0] == ends[:, 1]
    return np.bincount(ends.flatten(), minlength=entities) - np.bincount(ends[twice, 0], minlength=entities)
