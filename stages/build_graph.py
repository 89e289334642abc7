"""Count observations into the unique triples of a knowledge graph."""

from __future__ import annotations

from isi import graph, paths, tables
from isi.stage import Params, Provenance, stage


@stage("graph.min_count")
def build_graph(params: Params, provenance: Provenance) -> None:
    """Count observations into the unique triples of a knowledge graph."""
    source = paths.observations("ai2thor")
    observations = tables.read(source, tables.OBSERVATIONS, provenance)
    triples = graph.count_triples(observations, "ai2thor", params.graph.min_count)
    entities = graph.name_entities(triples, set(observations["room"].astype(str)), "ai2thor", source)
    tables.write(paths.entities("ai2thor"), entities, tables.ENTITIES, provenance)
    tables.write(paths.triples("ai2thor"), triples, tables.TRIPLES, provenance)
    print(f"{len(entities)} entities, {len(triples):,} unique triples of {triples['count'].sum():,} observations")


if __name__ == "__main__":
    build_graph()
