"""A knowledge graph by names, as tables, and by ids, as tensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError
from isi.tables.rules import MOST_OBSERVED, refuse

if TYPE_CHECKING:  # few commands need them: each import takes up to a second
    import pandas as pd
    from torch import Tensor

HEAD, RELATION, TAIL = range(3)  #: Columns of ``Graph.triples``.


@dataclass(frozen=True)
class Graph:
    """Entities, relations and unique triples of an experiment, by id."""

    entities: list[str]
    relations: list[str]
    triples: Tensor  #: head, relation, tail ids; shape: (T, 3), int64
    counts: Tensor  #: observations of each unique triple; shape: (T,), int64
    #: id of each entity's kind; kinds are numbered alphabetically; shape: (E,), int64
    kinds: Tensor

    def part(self, triples: np.ndarray) -> Graph:
        """The graph with the unique triples of the given ids, (N,), alone;
        all entities and relations stay.
        """
        return replace(self, triples=self.triples[triples], counts=self.counts[triples])

    def same_but(self, slot: int, triples: Tensor) -> Tensor:
        """Ids, (..., X), of triples that agree with ``triples``, ids (...), outside ``slot``;
        padded with -1.
        """
        import torch

        key, order, ordered = self._by_other_slots[slot]
        first = torch.searchsorted(ordered, key[triples])
        last = torch.searchsorted(ordered, key[triples], right=True)
        place = first[..., None] + torch.arange(int((last - first).max()))
        return torch.where(place < last[..., None], order[place.clamp(max=len(order) - 1)], -1)

    @cached_property
    def _by_other_slots(self) -> dict[int, tuple[Tensor, Tensor, Tensor]]:
        """For each slot: each triple's key (its other slots), triple ids sorted by key,
        the sorted keys; (T,) each.
        """
        import torch

        sorted_by_slot = {}
        for slot in (HEAD, RELATION, TAIL):
            first, second = (
                self.triples[:, place] for place in (HEAD, RELATION, TAIL) if place != slot
            )
            key = first * max(len(self.entities), len(self.relations)) + second
            order = torch.argsort(key, stable=True)
            sorted_by_slot[slot] = (key, order, key[order])
        return sorted_by_slot


def build_graph(
    entities: pd.DataFrame, triples: pd.DataFrame, path: Path | str = "triples.parquet"
) -> Graph:
    """The graph of both tables; entity ids are row numbers, relation ids alphabetical;
    InputError for unknown ends.
    """
    import torch

    names = [str(name) for name in entities["entity"]]
    relations = sorted({str(name) for name in triples["relation"]})
    heads, tails = (_ids(triples, column, names, path) for column in ("head", "tail"))
    ids = np.stack([heads, _ids(triples, "relation", relations, path), tails], axis=1)
    kinds = np.unique(entities["kind"].astype(str), return_inverse=True)[1]
    counts = np.array(triples["count"], np.int64)  # a copy: columns may be read-only
    return Graph(names, relations, *map(torch.as_tensor, (ids, counts, kinds.astype(np.int64))))


def _ids(triples: pd.DataFrame, column: str, names: list[str], path: Path | str) -> np.ndarray:
    import pandas as pd

    ids = pd.Index(names).get_indexer(pd.Index(triples[column].astype(str)))
    refuse(path, triples, ids < 0, [column], "expected a name in entities.parquet")
    return ids.astype(np.int64)


@dataclass(frozen=True)
class MinedSource:
    """The observations of a source (columns ``isi.sources.OBSERVED``), and its entities with kind
    and phrase.
    """

    source: str
    observations: pd.DataFrame
    kinds: pd.DataFrame
    file: Path | None = None  #: file of the observations, for error messages


@dataclass(frozen=True)
class GraphTables:
    """A graph as tables: entities with kind, source and phrase; unique triples with counts."""

    entities: pd.DataFrame
    triples: pd.DataFrame

    def __str__(self) -> str:
        total = self.triples["count"].sum()
        return (
            f"{len(self.entities)} entities, {len(self.triples):,} unique "
            f"triples of {total:,} observations"
        )


def build_tables(seen: MinedSource) -> GraphTables:
    """Sorted triples and their entities; InputError for no kind or too many observations."""
    if seen.observations["count"].sum() > MOST_OBSERVED:
        raise InputError(seen.source, "observations", f"expected at most {MOST_OBSERVED:,} in all")
    key = ["head", "relation", "tail"]
    plain = seen.observations.astype(dict.fromkeys(key, str))
    triples = plain.groupby(key, sort=True, observed=True)["count"].sum().reset_index()
    names = set(triples["head"]) | set(triples["tail"])
    if missing := names - set(seen.kinds["entity"]):
        raise InputError(
            seen.file or seen.source, "", f"expected a kind for entity {min(missing)!r}, got none"
        )
    entities = (
        seen.kinds[seen.kinds["entity"].isin(names)].sort_values("entity").reset_index(drop=True)
    )
    triples = triples.assign(source=seen.source).astype({"count": "int32"})
    return GraphTables(entities.assign(source=seen.source), triples)
