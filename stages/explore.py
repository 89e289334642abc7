"""An experiment on a graph of its own, from its source to what its models answer."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from isi.analyses.other_graphs import (
    GRAPH_QUERIES,
    GRAPH_RUNS,
    GraphExperiment,
)
from isi.analyses.variants import changed, results
from isi.errors import InputError
from isi.experiment.store import Store
from isi.graph import graph as building
from isi.graph.graph import GraphTables, MinedSource, build_graph
from isi.graph.sampling import Shares, session_tables
from isi.graph.tables import ENTITIES, GRAPH_ENTITIES, GRAPH_TRIPLES, INSERT_TRIPLES, NOVEL, SPLITS, TRIPLES
from isi.graph.words import load_vectors, look_up
from isi.sources import observing
from isi.sources.tables import OBSERVATIONS
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def explore(given: StageContext, graph: str) -> None:
    """Run an experiment on a graph of its own: mine, draw sessions, train, insert, and fine-tune until convergence."""
    key = f"graphs.{graph}"
    how = given.section(key, GraphExperiment)
    try:
        found = building.build_tables(seen_by(graph, how, given.seed, f"{key}.source"), how.min_count)
        if found.triples.empty:
            raise InputError(f"{key}.source", "", f"expected triples that are observed {how.min_count} times")
        store = held(given, graph, found, how, key)
    except InputError as error:
        raise InputError(paths.BEYOND_PARAMS, key, str(error)) from error
    study = how.variant(graph)
    runs, asked = results(changed(given, how.changes, f"{key}.changes"), study, [store], graph)
    GRAPH_ENTITIES.write(found.entities, given.stage, graph=graph)
    GRAPH_TRIPLES.write(found.triples, given.stage, graph=graph)
    GRAPH_RUNS.write(runs, given.stage, graph=graph)
    GRAPH_QUERIES.write(asked, given.stage, graph=graph)


def seen_by(graph: str, how: GraphExperiment, root: int, key: str) -> MinedSource:
    """What the source observes."""
    observed, passing = observing(how.source, key, root)
    parts = pa.concat_tables([OBSERVATIONS.schema.empty_table(), *passing]).unify_dictionaries()
    frame: pd.DataFrame = parts.to_pandas()
    for step, instances in observed.mining.left.items():
        print(f"{instances:,} {step}")
    return MinedSource(graph, frame, observed.kinds)


def held(given: StageContext, graph: str, found: GraphTables, how: GraphExperiment, key: str) -> Store:
    """The graph with its word vectors and its sessions."""
    words = look_up(load_vectors(how.words), list(found.entities["phrase"]))
    shares, of_ids = given.section("sessions", Shares), build_graph(found.entities, found.triples)
    drawn = session_tables(of_ids, found.entities, how.sessions, shares, given.seed, f"{key}.sessions")
    tables = {
        ENTITIES: found.entities, TRIPLES: found.triples, SPLITS: drawn.splits, NOVEL: drawn.novel,
        INSERT_TRIPLES: drawn.insert_triples,
    }  # fmt: skip
    size, missing = found.triples["count"].sum(), words.served_by.count(None)
    print(f"{len(found.entities)} entities, {len(found.triples):,} unique triples of {size:,} observations")
    print(f"{len(found.entities) - missing} of {len(found.entities)} entities have a word vector")
    return Store(graph, tables, words.vectors)


if __name__ == "__main__":
    explore()
