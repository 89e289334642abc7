"""Query sets: the triples that are queried, with filter and candidates, to measure old and new knowledge apart."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.evaluation.ranking import Queries, make_queries, padded_ids
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership, touches


def validation(session: Session) -> dict[str, Queries]:
    """Query set valid, of early stopping: the validation triples, with train and valid as filter."""
    valid = session.members(VALID)
    queries = make_queries(session, padded_ids(valid), valid, session.members(TRAIN, VALID), session.entities)
    return {"valid": queries}


def epoch_query_sets(session: Session, novel: Tensor) -> dict[str, Queries]:
    """Query sets of a session, D¹, that are measured through training; ``novel`` are ids of shape (M, n)."""
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
    """Query set novel of D¹, right after insertion: triples with a novel entity, (M, n), minus those inserted."""
    return {"novel": _at_insertion(session, novel, novel, inserted)}


def entity_query_sets(session: Session, novel: Tensor, inserted: Tensor) -> list[Queries]:
    """The queries of query set novel that touch one novel entity: one stack for each place in ``novel``."""
    return [_at_insertion(session, novel, of, inserted) for of in torch.split(novel, 1, 1)]


def _at_insertion(session: Session, novel: Tensor, of: Tensor, inserted: Tensor) -> Queries:
    """Queries of the triples of some novel entities; the filter is what is known after insertion."""
    graph, entities = session.graph, session.entities.shape[1]
    new, of_entities = (touches(graph, membership(ids, entities)) for ids in (novel, of))
    queried = session.members(TRAIN, VALID, TEST) & of_entities & ~inserted
    filtered = (session.members(TRAIN, VALID) & ~new) | inserted
    return make_queries(session, padded_ids(queried), queried, filtered, session.entities)
