"""The knowledge graph: entities, relations, unique triples and how often each was observed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.errors import InputError

#: Columns of ``Graph.triples``.
HEAD, RELATION, TAIL = range(3)


@dataclass(frozen=True)
class Graph:
    """Entities, relations and unique triples of an experiment, by id."""

    entities: list[str]
    relations: list[str]
    #: head, relation, tail ids; shape: (T, 3), int64
    triples: Tensor
    #: observations of each unique triple; shape: (T,), int64
    counts: Tensor

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as plain arrays."""
        return _from_arrays, (self.entities, self.relations, self.triples.numpy(), self.counts.numpy())

    def on(self, device: torch.device) -> Graph:
        """The graph with its tensors on a device."""
        return Graph(self.entities, self.relations, self.triples.to(device), self.counts.to(device))

    def part(self, triples: np.ndarray) -> Graph:
        """The graph of some unique triples, given by id; entities and relations stay."""
        return Graph(self.entities, self.relations, self.triples[triples], self.counts[triples])

    def same_but(self, slot: int, triples: Tensor) -> Tensor:
        """The unique triples that are like given ones in all but one slot (themselves among them).

        Args:
            slot: HEAD, RELATION or TAIL.
            triples: ids; shape (...).

        Returns:
            ids, padded with -1 to the longest list; shape (..., X).
        """
        key, order, ordered = self._by_other_slots[slot]
        first, last = torch.searchsorted(ordered, key[triples]), torch.searchsorted(ordered, key[triples], right=True)
        place = first[..., None] + torch.arange(int((last - first).max()))
        return torch.where(place < last[..., None], order[place.clamp(max=len(order) - 1)], -1)

    @cached_property
    def _by_other_slots(self) -> dict[int, tuple[Tensor, Tensor, Tensor]]:
        """For each slot: a number for the other two of each triple, the triples in its order, and it in order."""
        found = {}
        for slot in (HEAD, RELATION, TAIL):
            one, other = (self.triples[:, place] for place in (HEAD, RELATION, TAIL) if place != slot)
            key = one * max(len(self.entities), len(self.relations)) + other
            order = torch.argsort(key, stable=True)
            found[slot] = (key, order, key[order])
        return found


def _from_arrays(entities: list[str], relations: list[str], triples: np.ndarray, counts: np.ndarray) -> Graph:
    return Graph(entities, relations, torch.from_numpy(triples), torch.from_numpy(counts))


def build(entities: pd.DataFrame, triples: pd.DataFrame) -> Graph:
    """The graph of an experiment's tables: entity ids are row numbers, relation ids alphabetical."""
    names = [str(name) for name in entities["entity"]]
    relations = sorted({str(name) for name in triples["relation"]})
    entity_id = {name: number for number, name in enumerate(names)}
    relation_id = {name: number for number, name in enumerate(relations)}
    ids = np.stack(
        [
            triples["head"].astype(str).map(entity_id),
            triples["relation"].astype(str).map(relation_id),
            triples["tail"].astype(str).map(entity_id),
        ],
        axis=1,
    )
    if np.isnan(ids.astype(float)).any():
        raise InputError("triples.parquet", "columns 'head' and 'tail'", "expected names that are in entities.parquet")
    return Graph(
        names, relations, torch.as_tensor(ids.astype(np.int64)), torch.as_tensor(triples["count"].to_numpy(np.int64))
    )
