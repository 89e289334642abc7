"""Why an inserted entity lies where it does: its vector without each insert triple, its words, and each indicator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch.nn.functional import cosine_similarity

from isi.bundle.folder import InsertionRecord
from isi.bundle.insert import Indicator, NewEntity, before, insert_entity
from isi.bundle.query import OpenBundle, Query
from isi.errors import InputError


@dataclass(frozen=True)
class Change:
    """A query whose best answers change."""

    #: by name, with a question mark
    query: tuple[str, str, str]
    #: answers that are among the best no longer, and those that replace them
    dropped: list[str]
    added: list[str]


@dataclass(frozen=True)
class Ablation:
    """An insertion without one piece of what was given."""

    #: fact, words, indicator
    left_out: str
    #: the triple as text, the phrase, or the indicator
    what: str
    #: null where nothing is left to insert it by
    initializer: str | None = None
    #: between this vector and the entity's; null where there is none
    cosine: float | None = None
    #: distance between this vector and the entity's, over the length of the entity's
    moved: float | None = None
    changes: Sequence[Change] = ()


def ablations(
    opened: OpenBundle, record: InsertionRecord, shown: Sequence[Indicator], queries: Sequence[Query], most: int
) -> Iterator[Ablation]:
    """The insertion without each insert triple, without its words, and as if each indicator were unknown.

    Args:
        shown: indicators.
        queries: whose best answers are compared.
        most: answers that are compared, at most.
    """
    known, new = before(opened, record)

    def without(triples: list[tuple[str, str, str]]) -> NewEntity:
        return replace(new, request=new.request.model_copy(update={"insert_triples": triples}))

    pieces = [
        ("fact", " ".join(triple), known, without([other for other in record.insert_triples if other != triple]))
        for triple in record.insert_triples
    ]
    if new.vector is not None:
        pieces.append(("words", new.phrase, known, replace(new, vector=None)))
    for indicator in shown:
        rest = [triple for triple in record.insert_triples if indicator.entity not in (triple[0], triple[2])]
        fewer = known.part(np.delete(np.arange(len(known.entities)), indicator.id))
        pieces.append(("indicator", indicator.entity, fewer, without(rest)))
    for left_out, piece, fewer, given in pieces:
        try:
            other = insert_entity(fewer, given)
        except InputError:
            if given.request.insert_triples or given.vector is not None:
                raise
            yield Ablation(left_out, piece)
            continue
        entities = opened.entities.copy()
        entities[len(known.entities)] = other.vector
        own, vector = (torch.from_numpy(table[len(known.entities)]).double() for table in (opened.entities, entities))
        moved = (vector - own).norm() / own.norm().clamp(min=1e-12)
        changes = list(_changes(opened, replace(opened, entities=entities), queries, most))
        cosine = cosine_similarity(vector, own, dim=0).item()
        yield Ablation(left_out, piece, other.result.initializer, cosine, moved.item(), changes)


def _changes(opened: OpenBundle, changed: OpenBundle, queries: Sequence[Query], most: int) -> Iterator[Change]:
    """Queries whose best answers change."""
    for query in queries:
        was, now = (
            [opened.entity_names[row] for row in bundle.ranked(query)[0][:most].tolist()]
            for bundle in (opened, changed)
        )
        if set(was) != set(now):
            dropped, added = [name for name in was if name not in now], [name for name in now if name not in was]
            yield Change(opened.named(query), dropped, added)
