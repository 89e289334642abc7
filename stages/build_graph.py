"""Build the graph of an experiment: unique triples with counts, and, if params say so,
entities of a second source (section 6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Annotated

import pandas as pd

from isi.config import Count, EachOnce, Name, Section
from isi.errors import InputError
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.random import stream
from isi.tables import paths
from isi.tables.table import as_text
from stages.files import ENTITIES, KINDS, OBSERVATIONS, TRIPLES
from stages.stage import StageContext, stage


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


@stage
def build_graph(context: StageContext, experiment: str) -> None:
    key = f"experiments.{experiment}.graph"
    settings: GraphOf = context.params.read(key, GraphOf)
    tables = tables_of(settings, mined, key, context.params.seed)
    ENTITIES.write(tables.entities, context.stage, experiment=experiment)
    TRIPLES.write(tables.triples, context.stage, experiment=experiment)
    print(tables)


def mined(source: str) -> MinedSource:
    """The observations and entities that were mined from a source."""
    observations, kinds = OBSERVATIONS.read(source=source), KINDS.read(source=source)
    return MinedSource(source, observations, kinds, OBSERVATIONS.path(source=source))


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


def extend(graph: GraphTables, seen: MinedSource, added: Collection[str]) -> GraphTables:
    """``graph`` with the entities ``added``, and with the triples of ``seen`` from them to
    entities of the new graph.
    """
    joined, observed = {*graph.entities["entity"], *added}, seen.observations
    of_added = observed[observed["head"].isin(added) & observed["tail"].isin(joined)]
    more = build_tables(replace(seen, observations=of_added))
    new = more.entities[~more.entities["entity"].isin(graph.entities["entity"])]
    blocks = (graph.entities, new), (graph.triples, more.triples)
    return GraphTables(
        *(pd.concat([as_text(old), rows[list(old)]], ignore_index=True) for old, rows in blocks)
    )


def _kinds(entities: pd.DataFrame) -> dict[str, str]:
    return dict(zip(entities["entity"], entities["kind"].astype(str), strict=True))


if __name__ == "__main__":
    build_graph()
