"""Why an inserted entity lies where it does: its vector without each insert triple, its words, and each indicator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch.nn.functional import cosine_similarity

from isi.bundle.indicators import Indicator
from isi.bundle.insert_entity import InsertedEntity, NewEntity, before, insert_entity, without_entities
from isi.bundle.manifest import InsertionRecord
from isi.bundle.query import OpenBundle, Query
from isi.errors import InputError

LeftOut = Literal["fact", "words", "indicator"]


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

    left_out: LeftOut
    #: the triple as text, the phrase, or the indicator
    what: str
    #: null where nothing is left to insert it by
    initializer: str | None
    #: between this vector and the entity's; null where there is none
    cosine: float | None
    #: distance between this vector and the entity's, over the length of the entity's
    moved: float | None
    changes: list[Change]


def again(opened: OpenBundle, record: InsertionRecord) -> InsertedEntity:
    """The same insertion once more."""
    return insert_entity(*before(opened, record))


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
    entity = len(known.bundle.entities)

    def ablation(left_out: LeftOut, what: str, known: OpenBundle, new: NewEntity) -> Ablation:
        try:
            other = insert_entity(known, new)
        except InputError:
            if new.insert_triples or new.vector is not None:
                raise
            return Ablation(left_out, what, None, None, None, [])
        own, vector = (torch.from_numpy(row).double() for row in (opened.bundle.entities[entity], other.vector))
        moved = (vector - own).norm() / own.norm().clamp(min=1e-12)
        cosine = cosine_similarity(vector, own, dim=0).item()
        changes = list(_changes(opened, entity, other.vector, queries, most))
        return Ablation(left_out, what, other.result.initializer, cosine, moved.item(), changes)

    for triple in record.insert_triples:
        rest = [other for other in record.insert_triples if other != triple]
        yield ablation("fact", " ".join(triple), known, replace(new, insert_triples=rest))
    if new.vector is not None:
        yield ablation("words", new.phrase, known, replace(new, vector=None))
    for indicator in shown:
        rest = [triple for triple in record.insert_triples if indicator.entity not in (triple[0], triple[2])]
        fewer = without_entities(known, np.delete(np.arange(entity), indicator.id))
        yield ablation("indicator", indicator.entity, fewer, replace(new, insert_triples=rest))


def _changes(
    opened: OpenBundle, entity: int, vector: np.ndarray, queries: Sequence[Query], most: int
) -> Iterator[Change]:
    """Queries whose best answers change with the entity's vector."""
    entities = opened.bundle.entities.copy()
    entities[entity] = vector
    names, changed = opened.bundle.entity_names, OpenBundle(replace(opened.bundle, entities=entities), opened.model)
    for query in queries:
        was, now = ([names[row] for row in one.ranked(query)[0][:most].tolist()] for one in (opened, changed))
        if set(was) != set(now):
            yield Change(
                opened.named(query),
                [name for name in was if name not in now],
                [name for name in now if name not in was],
            )
