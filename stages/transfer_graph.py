"""Add entities of Matterport3D to AI2-THOR's knowledge graph."""

from __future__ import annotations

from isi import candidates, paths, tables
from isi.stage import Params, Provenance, stage


@stage("seed", "mp3d.min_observations", "transfer.candidates", "affordances.entities")
def transfer_graph(params: Params, provenance: Provenance) -> None:
    """Add entities of Matterport3D to AI2-THOR's knowledge graph."""
    source, minimum = paths.observations("mp3d"), params.mp3d.min_observations
    entities = tables.read(paths.entities("ai2thor"), tables.ENTITIES, provenance)
    triples = tables.read(paths.triples("ai2thor"), tables.TRIPLES, provenance)
    observations = tables.read(source, tables.OBSERVATIONS, provenance)
    unknown = candidates.unknown_objects(observations, entities, source)
    enough = candidates.frequent(unknown, minimum, entities, source)
    drawn = candidates.draw(enough, params.transfer.candidates, params.affordances.entities, params.seed)
    extended, more = candidates.extend(entities, triples, observations, drawn, "mp3d")
    tables.write(paths.entities("transfer"), extended, tables.ENTITIES, provenance)
    tables.write(paths.triples("transfer"), more, tables.TRIPLES, provenance)
    print(f"{len(unknown)} new objects, {len(enough)} of them observed {minimum} times or more, {len(drawn)} drawn")
    print(f"{len(extended)} entities, {len(more):,} unique triples of {more['count'].sum():,} observations")


if __name__ == "__main__":
    transfer_graph()
