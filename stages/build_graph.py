"""Count a source's observations into the unique triples of an experiment's graph, and let entities of another join."""

from __future__ import annotations

from isi.graph import graph as building
from isi.graph.graph import Extension, GraphOf, GraphTables, MinedSource
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths
from isi.tables.io import Provenance


@stage
def build_graph(given: StageContext, experiment: str) -> None:
    """Count a source's observations into the unique triples of an experiment's graph."""
    key, provenance = f"experiments.{experiment}.graph", given.provenance
    how = given.section(key, GraphOf)
    graph = building.build_tables(seen_by(how.source, provenance), how.min_count)
    if how.extend:
        graph = extended(graph, seen_by(how.extend.source, provenance), how.extend, f"{key}.extend", given.seed)
    io.write(paths.entities(experiment), graph.entities, catalogue.ENTITIES, provenance)
    io.write(paths.triples(experiment), graph.triples, catalogue.TRIPLES, provenance)
    total = graph.triples["count"].sum()
    print(f"{len(graph.entities)} entities, {len(graph.triples):,} unique triples of {total:,} observations")


def seen_by(source: str, provenance: Provenance) -> MinedSource:
    """What mining a source has given."""
    observations = io.read(paths.observations(source), catalogue.OBSERVATIONS, provenance)
    return MinedSource(source, observations, io.read(paths.kinds(source), catalogue.KINDS, provenance))


def extended(graph: GraphTables, seen: MinedSource, how: Extension, key: str, root: int) -> GraphTables:
    """The graph with entities that another source has and it lacks."""
    newcomers = building.new_entities(seen, graph.entities)
    enough = building.frequent(newcomers, seen, graph.entities, how.min_observations)
    drawn = building.sample_candidates(enough, how, key, root)
    least = how.min_observations
    print(f"{len(newcomers)} new, {len(enough)} of them observed {least} times or more, {len(drawn)} drawn")
    return building.extend(graph, seen, drawn)


if __name__ == "__main__":
    build_graph()
