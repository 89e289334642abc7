"""Scopes: which triples are queried about, and with what filter, so as to tell old knowledge from new."""

from __future__ import annotations

from torch import Tensor

from isi.evaluation.ranking import Queries, padded_ids, prepare
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership, touches


def validation(session: Session) -> dict[str, Queries]:
    """The validation triples, with train and valid as filter: what early stopping looks at."""
    queried = session.members(VALID)
    queries = prepare(session, padded_ids(queried), queried, session.members(TRAIN, VALID), session.entities)
    return {"valid": queries}


def epoch_query_sets(session: Session, novel: Tensor) -> dict[str, Queries]:
    """Scopes of D¹ that are followed through training: all, known, known_closed, novel_heldout.

    Args:
        session: D¹.
        novel: the novel entities of each model; shape (M, n).
    """
    is_novel = membership(novel, session.entities.shape[1])
    new = touches(session.graph, is_novel)
    test, heldout = session.members(TEST), session.members(VALID, TEST) & new
    slots = padded_ids(test | heldout)
    old, learned, everyone = test & ~new, session.members(TRAIN, VALID), session.entities
    return {
        "all": prepare(session, slots, test, learned, everyone),
        "known": prepare(session, slots, old, learned, everyone),
        "known_closed": prepare(session, slots, old, learned, everyone & ~is_novel),
        "novel_heldout": prepare(session, slots, heldout, session.members(TRAIN), everyone),
    }


def novel_query_set(session: Session, novel: Tensor, inserted: Tensor) -> dict[str, Queries]:
    """Scope novel, at insertion: what touches a novel entity, less its insert triples.

    Args:
        session: D¹.
        novel: shape (M, n).
        inserted: the insert triples; shape (M, T), bool.
    """
    queried, filtered = _at_insertion(session, novel, novel, inserted)
    return {"novel": prepare(session, padded_ids(queried), queried, filtered, session.entities)}


def entity_query_sets(session: Session, novel: Tensor, inserted: Tensor) -> list[Queries]:
    """The queries of scope novel that touch one novel entity: one stack for each place in ``novel``."""
    queries = []
    for place in range(novel.shape[1]):
        queried, filtered = _at_insertion(session, novel, novel[:, place : place + 1], inserted)
        queries.append(prepare(session, padded_ids(queried), queried, filtered, session.entities))
    return queries


def _at_insertion(session: Session, novel: Tensor, of: Tensor, inserted: Tensor) -> tuple[Tensor, Tensor]:
    graph, entities = session.graph, session.entities.shape[1]
    new = touches(graph, membership(novel, entities))
    about = touches(graph, membership(of, entities))
    queried = session.members(TRAIN, VALID, TEST) & about & ~inserted
    return queried, (session.members(TRAIN, VALID) & ~new) | inserted
