"""The knowledge graph: entities, relations, unique triples and how often each was observed."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    #: of each entity, numbered by the alphabet; shape: (E,), int64
    kinds: Tensor

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as plain arrays."""
        arrays = (tensor.numpy() for tensor in (self.triples, self.counts, self.kinds))
        return _from_arrays, (self.entities, self.relations, *arrays)

    def on(self, device: torch.device) -> Graph:
        """The graph with its tensors on a device."""
        tensors = (tensor.to(device) for tensor in (self.triples, self.counts, self.kinds))
        return Graph(self.entities, self.relations, *tensors)

    def part(self, triples: np.ndarray) -> Graph:
        """The graph of some unique triples, given by id; entities and relations stay."""
        return replace(self, triples=self.triples[triples], counts=self.counts[triples])

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


def _from_arrays(entities: list[str], relations: list[str], *arrays: np.ndarray) -> Graph:
    return Graph(entities, relations, *(torch.from_numpy(array) for array in arrays))


def build(entities: pd.DataFrame, triples: pd.DataFrame) -> Graph:
    """The graph of an experiment's tables: entity ids are row numbers, ids of relations and kinds alphabetical."""
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
    kinds = np.unique(entities["kind"].astype(str), return_inverse=True)[1]
    counts = triples["count"].to_numpy(np.int64)
    return Graph(names, relations, *map(torch.as_tensor, (ids.astype(np.int64), counts, kinds.astype(np.int64))))
