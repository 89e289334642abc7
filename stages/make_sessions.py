"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

from isi.graph.graph import build_graph
from isi.graph.sampling import SessionsOf, Shares, session_tables
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def make_sessions(given: StageContext, experiment: str) -> None:
    """Draw splits, novel entities and insert triples for every size and seed."""
    key, provenance = f"experiments.{experiment}.sessions", given.provenance
    entities = io.read(paths.entities(experiment), catalogue.ENTITIES, provenance)
    path = paths.triples(experiment)
    graph = build_graph(entities, io.read(path, catalogue.TRIPLES, provenance), path)
    shares = given.section("sessions", Shares)
    found = session_tables(graph, entities, given.section(key, SessionsOf), shares, given.seed, key)
    io.write(paths.splits(experiment), found.splits, catalogue.SPLITS, provenance)
    io.write(paths.novel(experiment), found.novel, catalogue.NOVEL, provenance)
    io.write(paths.insert_triples(experiment), found.insert_triples, catalogue.INSERT_TRIPLES, provenance)


if __name__ == "__main__":
    make_sessions()
