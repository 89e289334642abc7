"""Count a source's observations into the unique triples of an experiment's graph, and let entities of another join."""

from __future__ import annotations

from isi.graph import graph as building
from isi.graph.graph import Extension, GraphOf, GraphTables, MinedSource
from isi.graph.tables import ENTITIES, TRIPLES
from isi.sources.tables import KINDS, OBSERVATIONS
from isi.stage import StageContext, stage


@stage
def build_graph(given: StageContext, experiment: str) -> None:
    """Count a source's observations into the unique triples of an experiment's graph."""
    key = f"experiments.{experiment}.graph"
    how = given.section(key, GraphOf)
    graph = building.build_tables(seen_by(how.source), how.min_count)
    if how.extend:
        graph = extended(graph, seen_by(how.extend.source), how.extend, f"{key}.extend", given.seed)
    ENTITIES.write(graph.entities, given.stage, experiment=experiment)
    TRIPLES.write(graph.triples, given.stage, experiment=experiment)
    total = graph.triples["count"].sum()
    print(f"{len(graph.entities)} entities, {len(graph.triples):,} unique triples of {total:,} observations")


def seen_by(source: str) -> MinedSource:
    """What mining a source has given."""
    observations, kinds = OBSERVATIONS.read(source=source), KINDS.read(source=source)
    return MinedSource(source, observations, kinds, OBSERVATIONS.path(source=source))


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
