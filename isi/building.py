"""The graph of an experiment from the observations of its sources: counted, named, and extended (section 6.3)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

import pandas as pd
from pydantic import model_validator

from isi.base import paths
from isi.base.errors import InputError
from isi.base.params import Count, Name, Section, distinct
from isi.base.rules import MOST_OBSERVED
from isi.base.streams import stream


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
class Seen:
    """What a source observed (``tables.OBSERVATIONS``), and what kinds its entities are of (``tables.KINDS``)."""

    source: str
    observations: pd.DataFrame
    kinds: pd.DataFrame


@dataclass(frozen=True)
class GraphTables:
    """A graph as it is stored: ``tables.ENTITIES`` and ``tables.TRIPLES``."""

    entities: pd.DataFrame
    triples: pd.DataFrame


def graph_of(seen: Seen, min_count: int = 1) -> GraphTables:
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


def entities_of(triples: pd.DataFrame, seen: Seen) -> pd.DataFrame:
    """Entities of the triples, in alphabetical order (``tables.ENTITIES``).

    Raises:
        InputError: where the source gave one no kind.
    """
    names = set(triples["head"]) | set(triples["tail"])
    missing = names - set(seen.kinds["entity"])
    if missing:
        raise InputError(paths.kinds(seen.source), "", f"expected the kind of {min(missing)!r}")
    named = seen.kinds[seen.kinds["entity"].isin(names)].sort_values("entity")
    return named.assign(source=seen.source).reset_index(drop=True)


def newcomers(seen: Seen, entities: pd.DataFrame) -> pd.Series[int]:
    """How often each head was observed that the entities do not hold, in alphabetical order.

    Raises:
        InputError: where a tail is neither such a head nor, by name and kind, one of the entities.
    """
    here, there = _kinds(entities), _kinds(seen.kinds)
    totals = seen.observations["count"].groupby(seen.observations["head"].astype(str), sort=True).sum()
    for tail in sorted(set(seen.observations["tail"].astype(str)) - set(totals.index)):
        if here.get(tail) != there.get(tail):
            expected = "the graph that this source is to extend has no such entity"
            raise InputError(paths.observations(seen.source), f"{there.get(tail)} {tail!r}", expected)
    return totals[[here.get(name) is None or here[name] != there.get(name) for name in totals.index]]


def frequent(newcomers: pd.Series[int], seen: Seen, entities: pd.DataFrame, minimum: int) -> pd.Series[int]:
    """Those with at least a minimum of observations.

    Raises:
        InputError: where one bears the name of an entity of another kind.
    """
    enough = newcomers[newcomers >= minimum]
    here, there = _kinds(entities), _kinds(seen.kinds)
    for name in enough.index:
        if name in here:
            also = f"is also a name in the graph, of kind {here[name]}; give it another one in its source"
            raise InputError(paths.observations(seen.source), f"{there.get(name)} {name!r}", also)
    return enough


def draw(enough: pd.Series[int], how: Extension, key: str, root: int) -> list[str]:
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


def extend(home: GraphTables, seen: Seen, added: Collection[str]) -> GraphTables:
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
