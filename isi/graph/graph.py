"""The knowledge graph of an experiment, counted from the observations of its sources
and extended (section 6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from isi.config import Count, EachOnce, Name, Section
from isi.errors import InputError
from isi.random import stream
from isi.tables import paths
from isi.tables.rules import COUNT, MOST_OBSERVED, NAME, TEXT, refuse
from isi.tables.table import Table, as_text

if TYPE_CHECKING:  # few commands need them: each import takes up to a second
    import pandas as pd
    from torch import Tensor

#: Row numbers are ids, here and in ``TRIPLES``. Rows are grouped by source; the extended source is
#: first.
ENTITIES = Table(
    "data/graph/{experiment}/entities.parquet",
    {"entity": TEXT, "kind": NAME, "source": NAME, "phrase": TEXT},
    key=["entity"],
)
TRIPLES = Table(
    "data/graph/{experiment}/triples.parquet",
    {"head": NAME, "relation": NAME, "tail": NAME, "count": COUNT, "source": NAME},
    key=["head", "relation", "tail"],
)
#: ``ENTITIES`` and ``TRIPLES`` of a graph of the second pipeline.
GRAPH_ENTITIES = replace(ENTITIES, template="data/beyond/graphs/{graph}/entities.parquet")
GRAPH_TRIPLES = replace(TRIPLES, template="data/beyond/graphs/{graph}/triples.parquet")
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


class Extension(Section):
    """``graph.extend`` of an experiment in params:
    entities of another source that join the graph.
    """

    rules = (
        (
            lambda extension: len(extension.always) <= extension.candidates,
            "expected len(always) ≤ candidates",
        ),
    )
    source: Name
    min_observations: Count
    candidates: Count  #: maximal number of entities that join, ``always`` included
    always: Annotated[list[str], EachOnce]


class GraphOf(Section):
    """``graph`` of an experiment in params: the sources that it is built from."""

    source: Name
    extend: Extension | None = None


@dataclass(frozen=True)
class MinedSource:
    """The observations of a source (``OBSERVATIONS``) and its entities
    with their kinds (``KINDS``).
    """

    source: str
    observations: pd.DataFrame
    kinds: pd.DataFrame
    file: Path | None = None  #: file of the observations, for error messages


@dataclass(frozen=True)
class GraphTables:
    """A graph as tables: ``ENTITIES`` and ``TRIPLES``."""

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


def tables_of(
    settings: GraphOf, mined: Callable[[str], MinedSource], key: str, root: int
) -> GraphTables:
    """The graph that ``settings`` describe, as tables; ``mined`` gives a source;
    prints how many entities it adds.
    """
    tables = build_tables(mined(settings.source))
    if settings.extend is None:
        return tables
    source = mined(settings.extend.source)
    newcomers = new_entities(source, tables.entities)
    enough = frequent(newcomers, source, tables.entities, settings.extend.min_observations)
    drawn = sample_candidates(enough, settings.extend, f"{key}.extend", root)
    least = f"observed {settings.extend.min_observations} times or more"
    print(f"{len(newcomers)} new, {len(enough)} of them {least}, {len(drawn)} drawn")
    return extend(tables, source, drawn)


def new_entities(seen: MinedSource, entities: pd.DataFrame) -> pd.Series[int]:
    """Counts of heads that the graph lacks or has with another kind;
    InputError for such a tail that is no head.
    """
    here, there = _kinds(entities), _kinds(seen.kinds)
    totals = (
        seen.observations["count"].groupby(seen.observations["head"].astype(str), sort=True).sum()
    )
    for tail in sorted(set(seen.observations["tail"].astype(str)) - set(totals.index)):
        if here.get(tail) != there.get(tail):
            expected = "expected a head of this source, or an entity of the graph that it extends"
            raise InputError(seen.file or seen.source, f"{there.get(tail)} {tail!r}", expected)
    return totals[
        [here.get(name) is None or here[name] != there.get(name) for name in totals.index]
    ]


def frequent(
    newcomers: pd.Series[int], seen: MinedSource, entities: pd.DataFrame, minimum: int
) -> pd.Series[int]:
    """New entities with count ≥ ``minimum``; ``InputError`` if the graph has the
    same name with another kind.
    """
    enough, here = newcomers[newcomers >= minimum], _kinds(entities)
    for name in here.keys() & set(enough.index):
        also = (
            f"the graph has an entity of this name, of kind {here[name]}: "
            "rename one of the two in its source"
        )
        raise InputError(seen.file or seen.source, f"{_kinds(seen.kinds).get(name)} {name!r}", also)
    return enough


def sample_candidates(
    enough: pd.Series[int], settings: Extension, key: str, root: int
) -> list[str]:
    """``always`` and random others, up to ``candidates``, sorted;
    InputError if ``enough`` lacks one of ``always``.
    """
    for name in sorted(set(settings.always) - set(enough.index)):
        which = (
            f"that is not in the graph and has at least {settings.min_observations} observations"
        )
        expected = f"{name!r}: expected an entity of {settings.source} {which}"
        raise InputError(paths.PARAMS, f"{key}.always", expected)
    others = [str(name) for name in enough.index if name not in settings.always]
    free = min(settings.candidates - len(settings.always), len(others))
    drawn = stream(root, "transfer candidates").choice(len(others), free, replace=False)
    return sorted([*settings.always, *(others[place] for place in drawn)])


def extend(home: GraphTables, seen: MinedSource, added: Collection[str]) -> GraphTables:
    """``home`` with the entities ``added``, and with the triples of ``seen`` from them to
    entities of the new graph.
    """
    import pandas as pd

    joined, observed = {*home.entities["entity"], *added}, seen.observations
    of_added = observed[observed["head"].isin(added) & observed["tail"].isin(joined)]
    more = build_tables(replace(seen, observations=of_added))
    new = more.entities[~more.entities["entity"].isin(home.entities["entity"])]
    blocks = (home.entities, new), (home.triples, more.triples)
    return GraphTables(
        *(pd.concat([as_text(old), rows[list(old)]], ignore_index=True) for old, rows in blocks)
    )


def _kinds(entities: pd.DataFrame) -> dict[str, str]:
    return dict(zip(entities["entity"], entities["kind"].astype(str), strict=True))
