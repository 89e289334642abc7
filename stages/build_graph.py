"""Count a source's observations into the unique triples of an experiment's graph, and let entities of another join."""

from __future__ import annotations

from isi import building
from isi.base import paths, tables
from isi.base.stage import Given, Provenance, stage
from isi.building import Extension, GraphOf, GraphTables, Seen


@stage
def build_graph(given: Given, experiment: str) -> None:
    """Count a source's observations into the unique triples of an experiment's graph."""
    key, provenance = f"experiments.{experiment}.graph", given.provenance
    how = given.section(key, GraphOf)
    graph = building.graph_of(seen_by(how.source, provenance), how.min_count)
    if how.extend:
        graph = extended(graph, seen_by(how.extend.source, provenance), how.extend, f"{key}.extend", given.seed)
    tables.write(paths.entities(experiment), graph.entities, tables.ENTITIES, provenance)
    tables.write(paths.triples(experiment), graph.triples, tables.TRIPLES, provenance)
    total = graph.triples["count"].sum()
    print(f"{len(graph.entities)} entities, {len(graph.triples):,} unique triples of {total:,} observations")


def seen_by(source: str, provenance: Provenance) -> Seen:
    """What mining a source has given."""
    observations = tables.read(paths.observations(source), tables.OBSERVATIONS, provenance)
    return Seen(source, observations, tables.read(paths.kinds(source), tables.KINDS, provenance))


def extended(graph: GraphTables, seen: Seen, how: Extension, key: str, root: int) -> GraphTables:
    """The graph with entities that another source has and it lacks."""
    newcomers = building.newcomers(seen, graph.entities)
    enough = building.frequent(newcomers, seen, graph.entities, how.min_observations)
    drawn = building.draw(enough, how, key, root)
    least = how.min_observations
    print(f"{len(newcomers)} new, {len(enough)} of them observed {least} times or more, {len(drawn)} drawn")
    return building.extend(graph, seen, drawn)


if __name__ == "__main__":
    build_graph()
