"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

from isi.graph.graph import build_graph
from isi.graph.sampling import SessionsOf, Shares, session_tables
from isi.graph.tables import ENTITIES, INSERT_TRIPLES, NOVEL, SPLITS, TRIPLES
from isi.stage import StageContext, stage


@stage
def make_sessions(given: StageContext, experiment: str) -> None:
    """Draw splits, novel entities and insert triples for every size and seed."""
    key = f"experiments.{experiment}.sessions"
    entities = ENTITIES.read(experiment=experiment)
    graph = build_graph(entities, TRIPLES.read(experiment=experiment), TRIPLES.path(experiment=experiment))
    shares = given.section("sessions", Shares)
    found = session_tables(graph, entities, given.section(key, SessionsOf), shares, given.seed, key)
    SPLITS.write(found.splits, given.stage, experiment=experiment)
    NOVEL.write(found.novel, given.stage, experiment=experiment)
    INSERT_TRIPLES.write(found.insert_triples, given.stage, experiment=experiment)


if __name__ == "__main__":
    make_sessions()
