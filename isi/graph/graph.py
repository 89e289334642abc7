"""The knowledge graph: entities, relations, unique triples and how often each was observed.

The graph of an experiment from the observations of its sources: counted, named, and extended (section 6.3).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd
import torch
from pydantic import model_validator
from torch import Tensor

from isi.config import Count, Name, Section, distinct
from isi.errors import InputError
from isi.random import stream
from isi.tables import paths
from isi.tables.rules import MOST_OBSERVED, place_of

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


def build_graph(entities: pd.DataFrame, triples: pd.DataFrame, path: Path | str = "triples.parquet") -> Graph:
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


class Extension(Section):
    """Entities that another source has and the graph lacks, to join it."""

    source: Name
    min_observations: Count
    #: how many are drawn, with those that always are
    candidates: Count
    always: list[str]

    @model_validator(mode="after")
    def _room_for_always(self) -> Self:
        if not distinct(self.always) or len(self.always) > self.candidates:
            raise ValueError("always must not repeat, nor be more than candidates")
        return self


class GraphOf(Section):
    """What the graph of an experiment is made of."""

    source: Name
    min_count: Count
    extend: Extension | None = None


@dataclass(frozen=True)
class MinedSource:
    """What a source observed (``tables.OBSERVATIONS``), and what kinds its entities are of (``tables.KINDS``)."""

    source: str
    observations: pd.DataFrame
    kinds: pd.DataFrame
    #: that has the observations, for messages
    file: Path | None = None


@dataclass(frozen=True)
class GraphTables:
    """A graph as it is stored: ``tables.ENTITIES`` and ``tables.TRIPLES``."""

    entities: pd.DataFrame
    triples: pd.DataFrame


def build_tables(seen: MinedSource, min_count: int = 1) -> GraphTables:
    """The graph of a source; an entity whose triples were all dropped is none of its."""
    triples = count_triples(seen.observations, seen.source, min_count)
    return GraphTables(entities_of(triples, seen), triples)


def count_triples(observations: pd.DataFrame, source: str, min_count: int = 1) -> pd.DataFrame:
    """Unique triples with their counts, in alphabetical order (``tables.TRIPLES``).

    Raises:
        InputError: where there are more observations than a table may count.
    """
    if observations["count"].sum() > MOST_OBSERVED:
        raise InputError(source, "observations", f"expected {MOST_OBSERVED:,} at most, altogether")
    key = ["head", "relation", "tail"]
    plain = observations.astype(dict.fromkeys(key, str))
    counts = plain.groupby(key, sort=True, observed=True)["count"].sum().reset_index()
    kept = counts[counts["count"] >= min_count].reset_index(drop=True)
    return kept.assign(source=source).astype({"count": "int32"})


def entities_of(triples: pd.DataFrame, seen: MinedSource) -> pd.DataFrame:
    """Entities of the triples, in alphabetical order (``tables.ENTITIES``).

    Raises:
        InputError: where the source gave one no kind.
    """
    names = set(triples["head"]) | set(triples["tail"])
    missing = names - set(seen.kinds["entity"])
    if missing:
        raise InputError(seen.file or seen.source, "", f"expected the kind of {min(missing)!r}")
    named = seen.kinds[seen.kinds["entity"].isin(names)].sort_values("entity")
    return named.assign(source=seen.source).reset_index(drop=True)


def new_entities(seen: MinedSource, entities: pd.DataFrame) -> pd.Series[int]:
    """How often each head was observed that the entities do not hold, in alphabetical order.

    Raises:
        InputError: where a tail is neither such a head nor, by name and kind, one of the entities.
    """
    here, there = _kinds(entities), _kinds(seen.kinds)
    totals = seen.observations["count"].groupby(seen.observations["head"].astype(str), sort=True).sum()
    for tail in sorted(set(seen.observations["tail"].astype(str)) - set(totals.index)):
        if here.get(tail) != there.get(tail):
            expected = "the graph that this source is to extend has no such entity"
            raise InputError(seen.file or seen.source, f"{there.get(tail)} {tail!r}", expected)
    return totals[[here.get(name) is None or here[name] != there.get(name) for name in totals.index]]


def frequent(newcomers: pd.Series[int], seen: MinedSource, entities: pd.DataFrame, minimum: int) -> pd.Series[int]:
    """Those with at least a minimum of observations.

    Raises:
        InputError: where one bears the name of an entity of another kind.
    """
    enough = newcomers[newcomers >= minimum]
    here, there = _kinds(entities), _kinds(seen.kinds)
    for name in enough.index:
        if name in here:
            also = f"is also a name in the graph, of kind {here[name]}; give it another one in its source"
            raise InputError(seen.file or seen.source, f"{there.get(name)} {name!r}", also)
    return enough


def sample_candidates(enough: pd.Series[int], how: Extension, key: str, root: int) -> list[str]:
    """Draw entities at random (all where there are fewer), some of them always; in alphabetical order.

    Args:
        enough: by name, those that can be drawn.
        how: how many, and which always.
        key: where that stands in params.
        root: of every random stream.

    Raises:
        InputError: where one that must be there cannot be drawn.
    """
    for name in how.always:
        if name not in enough.index:
            which = f"that the graph lacks, observed {how.min_observations} times or more"
            raise InputError(paths.PARAMS, f"{key}.always", f"{name!r}: expected an entity of {how.source} {which}")
    others = [str(name) for name in enough.index if name not in how.always]
    free = min(how.candidates - len(how.always), len(others))
    drawn = stream(root, "transfer candidates").choice(len(others), free, replace=False)
    return sorted([*how.always, *(others[place] for place in drawn)])


def extend(home: GraphTables, seen: MinedSource, added: Collection[str]) -> GraphTables:
    """A graph with entities added behind its own, and their triples behind its own.

    Args:
        home: the graph.
        seen: by the other source; what it observed of entities that are neither the graph's nor added is left out.
        added: heads that the graph lacks.
    """
    joined = {*home.entities["entity"], *added}
    observed = seen.observations
    more = count_triples(observed[observed["head"].isin(added) & observed["tail"].isin(joined)], seen.source)
    named = entities_of(more, seen)
    new = named[~named["entity"].isin(home.entities["entity"])]
    return GraphTables(_behind(home.entities, new), _behind(home.triples, more))


def _kinds(entities: pd.DataFrame) -> dict[str, str]:
    return dict(zip(entities["entity"], entities["kind"].astype(str), strict=True))


def _behind(table: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    encoded = table.select_dtypes("category").columns
    return pd.concat([table.astype(dict.fromkeys(encoded, str)), more[list(table.columns)]], ignore_index=True)
