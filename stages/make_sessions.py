"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from isi import paths, sessions, tables
from isi.errors import InputError
from isi.experiments.store import Store
from isi.stage import Params, Provenance, stage


@stage("seed", "sessions.seeds", "sessions.sizes", "sessions.valid", "sessions.test", "sessions.insert_fraction")
def make_sessions(params: Params, provenance: Provenance) -> None:
    """Draw splits, novel entities and insert triples for every size and seed."""
    how, root = params.sessions, params.seed
    graph = Store("ai2thor", provenance).graph()
    if max(how.sizes) >= len(graph.entities):
        raise InputError(
            "params.yaml", "sessions.sizes", f"expected sizes below the graph's {len(graph.entities)} entities"
        )
    splits = [sessions.split(graph, root, seed, how.valid, how.test) for seed in range(how.seeds)]
    held_out = min(int((codes == code).sum()) for codes in splits for code in (sessions.VALID, sessions.TEST))
    asked = min(round(share * len(graph.triples)) for share in (how.valid, how.test))
    if not held_out or held_out < asked:
        expected = "expected shares that leave triples to each split (some must stay in train, for every entity)"
        raise InputError("params.yaml", "sessions.valid, sessions.test", expected)
    novel, insert = [], []
    for size in sorted(how.sizes):
        for seed, codes in enumerate(splits):
            drawn = sessions.draw_novel(len(graph.entities), root, size, seed)
            pairs = sessions.draw_insert_triples(graph, codes, drawn, root, seed, how.insert_fraction)
            novel += [(size, seed, entity) for entity in drawn]
            insert += [(size, seed, *pair) for pair in pairs]
    table = pd.DataFrame(
        {
            "seed": np.repeat(np.arange(how.seeds), len(graph.triples)),
            "triple": np.tile(np.arange(len(graph.triples)), how.seeds),
            "split": np.array(sessions.SPLITS)[np.concatenate(splits)],
        }
    )
    tables.write(paths.splits("ai2thor"), table, tables.SPLITS, provenance)
    tables.write(paths.novel("ai2thor"), pd.DataFrame(novel, columns=tables.NOVEL.names), tables.NOVEL, provenance)
    frame = pd.DataFrame(insert, columns=tables.INSERT_TRIPLES.names)
    tables.write(paths.insert_triples("ai2thor"), frame, tables.INSERT_TRIPLES, provenance)


if __name__ == "__main__":
    make_sessions()
