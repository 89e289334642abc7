"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

import numpy as np

from isi import paths, sessions
from isi.errors import InputError
from isi.experiments.store import Store, write_sessions
from isi.stage import Params, Provenance, stage


@stage("seed", "sessions.seeds", "sessions.sizes", "sessions.valid", "sessions.test", "sessions.insert_fraction")
def make_sessions(params: Params, provenance: Provenance) -> None:
    """Draw splits, novel entities and insert triples for every size and seed."""
    how, root = params.sessions, params.seed
    graph = Store("ai2thor", provenance).graph()
    if max(how.sizes) >= len(graph.entities):
        raise InputError(
            paths.PARAMS, "sessions.sizes", f"expected sizes below the graph's {len(graph.entities)} entities"
        )
    splits = [sessions.split(graph, root, seed, how.valid, how.test) for seed in range(how.seeds)]
    sessions.check_held_out(splits, how.valid, how.test)
    novel, insert = [], []
    for size in sorted(how.sizes):
        for seed, codes in enumerate(splits):
            drawn = sessions.draw_novel(len(graph.entities), root, size, seed)
            pairs = sessions.draw_insert_triples(graph, codes, drawn, root, seed, how.insert_fraction)
            novel += [(size, seed, entity) for entity in drawn]
            insert += [(size, seed, *pair) for pair in pairs]
    everything = np.arange(len(graph.triples))
    write_sessions("ai2thor", [(everything, codes) for codes in splits], novel, insert, provenance)


if __name__ == "__main__":
    make_sessions()
