"""Build the graph of an experiment: unique triples with counts, and, if params say so,
entities of a second source.
"""

from isi.graph import graph
from isi.graph.graph import ENTITIES, TRIPLES, MinedSource
from isi.sources import KINDS, OBSERVATIONS
from stages.stage import StageContext, stage


@stage
def build_graph(context: StageContext, experiment: str) -> None:
    settings, root = context.params.experiments[experiment].graph, context.params.seed
    tables = graph.tables_of(settings, mined, f"experiments.{experiment}.graph", root)
    ENTITIES.write(tables.entities, context.stage, experiment=experiment)
    TRIPLES.write(tables.triples, context.stage, experiment=experiment)
    print(tables)


def mined(source: str) -> MinedSource:
    """The observations and entities that were mined from a source."""
    observations, kinds = OBSERVATIONS.read(source=source), KINDS.read(source=source)
    return MinedSource(source, observations, kinds, OBSERVATIONS.path(source=source))


if __name__ == "__main__":
    build_graph()
