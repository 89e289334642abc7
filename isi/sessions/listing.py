"""The sessions of a graph as tables: who has which split, who is novel, what is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.graph import Graph
from isi.sessions.drawing import SessionsOf, Shares, candidates_of, draw
from isi.sessions.session import SPLITS


@dataclass(frozen=True)
class Sessions:
    """The sessions of an experiment: ``tables.SPLITS``, ``tables.NOVEL`` and ``tables.INSERT_TRIPLES``."""

    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame


def listed(graph: Graph, entities: pd.DataFrame, how: SessionsOf, shares: Shares, root: int, key: str) -> Sessions:
    """The sessions of a graph, drawn for every size and seed.

    D of the last session is all that is not replaceable, and who is drawn; the triples of the others have no split.

    Args:
        entities: of the graph (``tables.ENTITIES``).
        root: of every random stream.
        key: where ``how`` stands in params.

    Raises:
        InputError: where there are too few that may be novel, or there is no triple.
    """
    if not len(graph.triples):
        raise InputError(paths.PARAMS, key, "expected a graph with triples")
    added = np.flatnonzero(entities["source"].astype(str) != str(entities["source"].iloc[0]))
    candidates = candidates_of(how, entities["kind"].to_numpy(str), added)
    if how.steps * max(how.sizes) > len(candidates) - (how.novel != "added"):
        few = f"expected fewer novel entities than the {len(candidates)} that may be novel"
        raise InputError(paths.PARAMS, f"{key}.sizes", few)
    drawn = list(draw(graph, candidates, added if how.novel == "added" else added[:0], how, shares, root))
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
    return Sessions(
        splits,
        pd.DataFrame(novel, columns=tables.NOVEL.names),
        pd.DataFrame(told, columns=tables.INSERT_TRIPLES.names),
    )
