"""Draw ten of the entities that only Matterport3D has, a split and insert triples for every repeat of the transfer."""

from __future__ import annotations

import numpy as np

from isi import paths, sessions
from isi.errors import InputError
from isi.experiments.store import Store, write_sessions
from isi.stage import Params, Provenance, stage

EXPERIMENT = "transfer"


@stage("seed", "transfer.size", "transfer.seeds", "sessions.valid", "sessions.test", "sessions.insert_fraction")
def transfer_sessions(params: Params, provenance: Provenance) -> None:
    """Draw novel entities among those that only Matterport3D has, a split and insert triples, for every repeat.

    D¹ of a repeat is AI2-THOR's entities and those drawn; the triples of the others have no split (section 6.3).
    """
    how, root, size = params.sessions, params.seed, params.transfer.size
    store = Store(EXPERIMENT, provenance)
    graph = store.graph()
    candidates = np.flatnonzero(store.entities()["source"].astype(str) == "mp3d")
    if size > len(candidates):
        raise InputError(paths.PARAMS, "transfer.size", f"expected at most {len(candidates)}, the candidates there are")
    splits, novel, insert = [], [], []
    for seed in range(params.transfer.seeds):
        drawn = candidates[sessions.draw_novel(len(candidates), root, size, seed)]
        triples = sessions.without(graph, np.setdiff1d(candidates, drawn))
        part = graph.part(triples)
        codes = sessions.split(part, root, seed, how.valid, how.test)
        sessions.check_held_out([codes], how.valid, how.test)
        pairs = sessions.draw_insert_triples(part, codes, drawn, root, seed, how.insert_fraction)
        splits.append((triples, codes))
        novel += [(size, seed, entity) for entity in drawn]
        insert += [(size, seed, entity, triples[triple]) for entity, triple in pairs]
    write_sessions(EXPERIMENT, splits, novel, insert, provenance)


if __name__ == "__main__":
    transfer_sessions()
