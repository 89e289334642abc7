"""The knowledge graph: entities, relations, unique triples and how often each was observed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.errors import InputError
from isi.base.rules import place_of

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


def build(entities: pd.DataFrame, triples: pd.DataFrame, path: Path | str = "triples.parquet") -> Graph:
    """The graph of an experiment's tables: entity ids are row numbers, ids of relations and kinds alphabetical.

    Args:
        path: of the triples, for errors.

    Raises:
        InputError: where a triple is of an entity that the others lack.
    """
    names = [str(name) for name in entities["entity"]]
    relations = sorted({str(name) for name in triples["relation"]})
    heads, tails = (_ids(triples, column, names, path) for column in ("head", "tail"))
    ids = np.stack([heads, _ids(triples, "relation", relations, path), tails], axis=1)
    kinds = np.unique(entities["kind"].astype(str), return_inverse=True)[1]
    counts = triples["count"].to_numpy(np.int64)
    return Graph(names, relations, *map(torch.as_tensor, (ids, counts, kinds.astype(np.int64))))


def _ids(triples: pd.DataFrame, column: str, names: list[str], path: Path | str) -> np.ndarray:
    ids = pd.Index(names).get_indexer(pd.Index(triples[column].astype(str)))
    if (ids < 0).any():
        raise InputError(path, place_of(triples, int(ids.argmin()), [column]), "expected a name in entities.parquet")
    return ids.astype(np.int64)
