"""Draw splits, novel entities and insert triples for every size and seed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.graph import build
from isi.sessions.drawing import SessionsOf, Shares, candidates_of, draw
from isi.sessions.session import SPLITS


@stage
def make_sessions(given: Given, experiment: str) -> None:
    """Draw splits, novel entities and insert triples for every size and seed.

    D of the last session is all that is not replaceable, and who is drawn; the triples of the others have no split.
    """
    key = f"experiments.{experiment}.sessions"
    how, provenance = given.section(key, SessionsOf), given.provenance
    entities = tables.read(paths.entities(experiment), tables.ENTITIES, provenance)
    graph = build(entities, tables.read(paths.triples(experiment), tables.TRIPLES, provenance))
    added = np.flatnonzero(entities["source"].astype(str) != str(entities["source"].iloc[0]))
    candidates = candidates_of(how, entities["kind"].to_numpy(str), added)
    if how.steps * max(how.sizes) > len(candidates) - (how.novel != "added"):
        few = f"expected fewer novel entities than the {len(candidates)} that may be novel"
        raise InputError(paths.PARAMS, f"{key}.sizes", few)
    shares = given.section("sessions", Shares)
    drawn = list(draw(graph, candidates, added if how.novel == "added" else added[:0], how, shares, given.seed))
    splits = pd.concat(
        pd.DataFrame({"seed": one.seed, "triple": one.triples, "split": np.array(SPLITS)[one.splits]})
        for one in drawn
        if one.size == drawn[0].size  # once for each seed
    )
    novel = [
        (one.size, one.seed, entity, session)
        for one in drawn
        for session, entities_of in enumerate(one.novel, 1)
        for entity in entities_of
    ]
    told = [(o.size, o.seed, entity, triple, session) for o in drawn for session, entity, triple in o.insert_triples]
    tables.write(paths.splits(experiment), splits, tables.SPLITS, provenance)
    for path, rows, schema in (
        (paths.novel(experiment), novel, tables.NOVEL),
        (paths.insert_triples(experiment), told, tables.INSERT_TRIPLES),
    ):
        tables.write(path, pd.DataFrame(rows, columns=schema.names), schema, provenance)


if __name__ == "__main__":
    make_sessions()
