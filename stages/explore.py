"""An experiment on a graph of its own, from its source to what its models answer."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from isi.analyses.other_graphs import GraphExperiment, InMemoryStore
from isi.analyses.variants import changed, results
from isi.errors import InputError
from isi.graph import graph as building
from isi.graph.graph import GraphTables, MinedSource, build_graph
from isi.graph.sampling import Shares, session_tables
from isi.graph.words import load_vectors, look_up
from isi.sources import observing
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def explore(given: StageContext, graph: str) -> None:
    """Run an experiment on a graph of its own: mine, draw sessions, train, insert, and fine-tune until convergence."""
    key, provenance = f"graphs.{graph}", given.provenance
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
    io.write(paths.explored(graph, "entities"), found.entities, catalogue.ENTITIES, provenance)
    io.write(paths.explored(graph, "triples"), found.triples, catalogue.TRIPLES, provenance)
    io.write(paths.explored(graph, "runs"), runs, catalogue.VARIANTS, provenance)
    io.write(paths.explored(graph, "asked"), asked, catalogue.VARIANTS_ASKED, provenance)


def seen_by(graph: str, how: GraphExperiment, root: int, key: str) -> MinedSource:
    """What the source observes."""
    observed, passing = observing(how.source, key, root)
    parts = pa.concat_tables([catalogue.OBSERVATIONS.columns.empty_table(), *passing]).unify_dictionaries()
    frame: pd.DataFrame = parts.to_pandas()
    for step, instances in observed.mining.left.items():
        print(f"{instances:,} {step}")
    return MinedSource(graph, frame, observed.kinds)


def held(given: StageContext, graph: str, found: GraphTables, how: GraphExperiment, key: str) -> InMemoryStore:
    """The graph with its word vectors and its sessions."""
    words = look_up(load_vectors(how.words), list(found.entities["phrase"]))
    shares, of_ids = given.section("sessions", Shares), build_graph(found.entities, found.triples)
    drawn = session_tables(of_ids, found.entities, how.sessions, shares, given.seed, f"{key}.sessions")
    size, missing = found.triples["count"].sum(), words.served_by.count(None)
    print(f"{len(found.entities)} entities, {len(found.triples):,} unique triples of {size:,} observations")
    print(f"{len(found.entities) - missing} of {len(found.entities)} entities have a word vector")
    return InMemoryStore(graph, given.provenance, found, words.vectors, drawn)


if __name__ == "__main__":
    explore()
