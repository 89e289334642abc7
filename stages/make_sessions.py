"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.graph import build
from isi.sessions.drawing import SessionsOf, Shares
from isi.sessions.listing import listed


@stage
def make_sessions(given: Given, experiment: str) -> None:
    """Draw splits, novel entities and insert triples for every size and seed."""
    key, provenance = f"experiments.{experiment}.sessions", given.provenance
    entities = tables.read(paths.entities(experiment), tables.ENTITIES, provenance)
    path = paths.triples(experiment)
    graph = build(entities, tables.read(path, tables.TRIPLES, provenance), path)
    shares = given.section("sessions", Shares)
    found = listed(graph, entities, given.section(key, SessionsOf), shares, given.seed, key)
    tables.write(paths.splits(experiment), found.splits, tables.SPLITS, provenance)
    tables.write(paths.novel(experiment), found.novel, tables.NOVEL, provenance)
    tables.write(paths.insert_triples(experiment), found.insert_triples, tables.INSERT_TRIPLES, provenance)


if __name__ == "__main__":
    make_sessions()
