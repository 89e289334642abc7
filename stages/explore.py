"""Run an experiment on another graph: mine, sample sessions, train, insert,
and fine-tune until convergence.
"""

import pandas as pd

from isi.analyses.variants import GRAPH_QUERIES, GRAPH_RUNS, GraphExperiment, changed, results
from isi.errors import InputError, at
from isi.graph.graph import GRAPH_ENTITIES, GRAPH_TRIPLES, MinedSource, build_tables
from isi.sources import Source
from isi.tables import paths
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def explore(context: StageContext, graph: str) -> None:
    key, settings, params = f"graphs.{graph}", context.beyond.graphs[graph], context.params
    with at(paths.BEYOND_PARAMS, key):
        tables = build_tables(mined(graph, settings, params.seed, f"{key}.source"))
        if tables.triples.empty:
            raise InputError("", "source", "expected triples, got none")
        store = Store.drawn(
            graph, tables, settings.words, settings.sessions, params.sessions, params.seed, key
        )
    variant = settings.variant(graph)
    config = changed(params, variant.changes).variant_config(variant)
    runs, answers = results(variant, [(store, config)], graph)
    for table, rows in (
        (GRAPH_ENTITIES, tables.entities),
        (GRAPH_TRIPLES, tables.triples),
        (GRAPH_RUNS, runs),
        (GRAPH_QUERIES, answers),
    ):
        table.write(rows, context.stage, graph=graph)


def mined(graph: str, settings: GraphExperiment, root: int, key: str) -> MinedSource:
    """Mine the observations and entities of the source."""
    source = Source(settings.source, key, root)
    observations = pd.concat(source.frames())
    for step, instances in source.counts.items():
        print(f"{instances:,} {step}")
    return MinedSource(graph, observations, source.kinds)


if __name__ == "__main__":
    explore()
