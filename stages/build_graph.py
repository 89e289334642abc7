"""Count a source's observations into the unique triples of an experiment's graph, and add entities of another one."""

from isi.graph import graph as building
from isi.graph.graph import Extension, GraphTables, MinedSource
from isi.graph.tables import ENTITIES, TRIPLES
from isi.sources.tables import KINDS, OBSERVATIONS
from isi.stage import StageContext, stage


@stage
def build_graph(context: StageContext, experiment: str) -> None:
    """Count a source's observations into the unique triples of an experiment's graph."""
    settings = context.params.experiments[experiment].graph
    graph = building.build_tables(observed(settings.source), settings.min_count)
    if settings.extend:
        key = f"experiments.{experiment}.graph.extend"
        graph = extended(graph, observed(settings.extend.source), settings.extend, key, context.params.seed)
    ENTITIES.write(graph.entities, context.stage, experiment=experiment)
    TRIPLES.write(graph.triples, context.stage, experiment=experiment)
    total = graph.triples["count"].sum()
    print(f"{len(graph.entities)} entities, {len(graph.triples):,} unique triples of {total:,} observations")


def observed(source: str) -> MinedSource:
    """What mining a source has given."""
    observations, kinds = OBSERVATIONS.read(source=source), KINDS.read(source=source)
    return MinedSource(source, observations, kinds, OBSERVATIONS.path(source=source))


def extended(graph: GraphTables, source: MinedSource, settings: Extension, key: str, root: int) -> GraphTables:
    """The graph with entities that another source has and it lacks."""
    newcomers = building.new_entities(source, graph.entities)
    frequent = building.frequent(newcomers, source, graph.entities, settings.min_observations)
    drawn = building.sample_candidates(frequent, settings, key, root)
    least = settings.min_observations
    print(f"{len(newcomers)} new, {len(frequent)} of them observed {least} times or more, {len(drawn)} drawn")
    return building.extend(graph, source, drawn)


if __name__ == "__main__":
    build_graph()
