"""Query sets: the triples that are queried, with filter and candidates,
for earlier knowledge and for novel entities.

Two of them say when fine-tuning has converged: when Θ¹ is about as good as the joint model
(section 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from isi.evaluation.ranking import Queries, make_queries, padded_ids
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership, touches

if TYPE_CHECKING:
    import pandas as pd

#: Query sets in which a run has to converge.
CONVERGING = ("all", "novel_heldout")


def validation(session: Session) -> dict[str, Queries]:
    """Query set ``valid`` of early stopping: the validation triples,
    filtered by train and valid.
    """
    valid = session.members(VALID)
    queries = make_queries(
        session, padded_ids(valid), valid, session.members(TRAIN, VALID), session.entities
    )
    return {"valid": queries}


def epoch_query_sets(session: Session, novel: Tensor) -> dict[str, Queries]:
    """Query sets of a session that are measured at every epoch, by scope;
    ``novel``: ids, shape (M, n).
    """
    is_novel = membership(novel, session.entities.shape[1])
    new = touches(session.graph, is_novel)
    test, heldout = session.members(TEST), session.members(VALID, TEST) & new
    triples = padded_ids(test | heldout)
    old, learned, everyone = test & ~new, session.members(TRAIN, VALID), session.entities
    return {
        "all": make_queries(session, triples, test, learned, everyone),
        "known": make_queries(session, triples, old, learned, everyone),
        "known_closed": make_queries(session, triples, old, learned, everyone & ~is_novel),
        "novel_heldout": make_queries(session, triples, heldout, session.members(TRAIN), everyone),
    }


def novel_query_set(session: Session, novel: Tensor, inserted: Tensor) -> dict[str, Queries]:
    """Query set ``novel``: a session's triples with a novel entity, ids (M, n),
    minus insert triples, a mask (M, T).
    """
    return {"novel": _at_insertion(session, novel, novel, inserted)}


def entity_query_sets(session: Session, novel: Tensor, inserted: Tensor) -> list[Queries]:
    """Query set ``novel`` by entity: for each column of ``novel``, (M, n),
    the triples with this novel entity.
    """
    return [_at_insertion(session, novel, of, inserted) for of in torch.split(novel, 1, 1)]


def _at_insertion(session: Session, novel: Tensor, of: Tensor, inserted: Tensor) -> Queries:
    """Queries of uninserted triples with entities ``of``;
    filter: ``inserted``, and train, valid without ``novel``.
    """
    graph, entities = session.graph, session.entities.shape[1]
    new, of_entities = (touches(graph, membership(ids, entities)) for ids in (novel, of))
    queried = session.members(TRAIN, VALID, TEST) & of_entities & ~inserted
    filtered = (session.members(TRAIN, VALID) & ~new) | inserted
    return make_queries(session, padded_ids(queried), queried, filtered, session.entities)


def epochs_to_convergence(
    runs: pd.DataFrame, joint: pd.DataFrame, margin: float, max_epochs: int, by: Sequence[str]
) -> pd.DataFrame:
    """The first epoch at which each run is within the margin of the joint model of the same scope,
    size and seed.

    Both tables: rows of ``RUNS``; columns ``by`` distinguish runs of one grid point. Runs that do
    not converge have ``max_epochs``; runs without queries have no row. Columns: ``by``, scope,
    size, seed, epochs, converged, queries.
    """
    keys = ["scope", "size", "seed"]
    target = joint[joint["scope"].isin(CONVERGING)].set_index(keys)["mrr_star"] - margin
    measured = (
        runs[runs["scope"].isin(CONVERGING)]
        .join(target.rename("target"), on=keys)
        .dropna(subset=["mrr_star"])
    )
    groups = [*by, *keys]
    reached = (
        measured[measured["mrr_star"] >= measured["target"]]
        .groupby(groups, observed=True)["epoch"]
        .min()
    )
    table = measured.groupby(groups, observed=True)["queries"].first().to_frame()
    table["converged"] = table.index.isin(reached.index)
    table["epochs"] = reached.reindex(table.index).fillna(max_epochs)
    return table.reset_index()
