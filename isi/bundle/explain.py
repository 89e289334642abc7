"""What an inserted entity's vector would be without a triple that was told, without its words, without an indicator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch.nn.functional import cosine_similarity

from isi.bundle.answers import Question, ranked
from isi.bundle.indicators import Indicator
from isi.bundle.insert_entity import InsertedEntity, NewEntity, before, insert_entity, without_entities
from isi.bundle.manifest import InsertionRecord
from isi.bundle.query import OpenBundle
from isi.errors import InputError


@dataclass(frozen=True)
class Change:
    """A question whose best answers are others."""

    question: Question
    #: best answers that are no longer among the best, and those that are instead
    gone: list[str]
    come: list[str]


@dataclass(frozen=True)
class Without:
    """An insertion without one of the things that it went by."""

    left_out: Literal["fact", "words", "indicator"]
    #: the triple as text, the phrase, or the indicator
    what: str
    #: null where nothing is left to go by
    initializer: str | None
    #: of the vector with the one that it has; null where there is none
    cosine: float | None
    #: how far apart both are, in lengths of the one that it has
    moved: float | None
    changes: list[Change]


def again(model: OpenBundle, record: InsertionRecord) -> InsertedEntity:
    """The same insertion once more."""
    return insert_entity(*before(model, record))


def each_left_out(
    model: OpenBundle, record: InsertionRecord, shown: Sequence[Indicator], questions: Sequence[Question], best: int
) -> Iterator[Without]:
    """The insertion without each triple, without its words, and without each indicator as though it were not known.

    Args:
        shown: indicators.
        questions: whose best answers are compared.
        best: answers.
    """
    then, news = before(model, record)
    entity = len(then.kept.entities)
    for fact in record.told:
        others = [one for one in record.told if one != fact]
        yield _compared(model, entity, "fact", " ".join(fact), then, replace(news, facts=others), questions, best)
    if news.vector is not None:
        yield _compared(model, entity, "words", news.phrase, then, replace(news, vector=None), questions, best)
    for one in shown:
        name = model.kept.entity_names[one.entity]
        others = [fact for fact in record.told if name not in (fact[0], fact[2])]
        fewer = without_entities(then, np.delete(np.arange(entity), one.entity))
        yield _compared(model, entity, "indicator", name, fewer, replace(news, facts=others), questions, best)


def _compared(
    model: OpenBundle, entity: int, left_out: Literal["fact", "words", "indicator"], what: str, then: OpenBundle,
    news: NewEntity,     questions: Sequence[Question], best: int,
) -> Without:  # fmt: skip
    try:
        other = insert_entity(then, news)
    except InputError:  # nothing is known of it
        if news.facts or news.vector is not None:
            raise
        return Without(left_out, what, None, None, None, [])
    own, vector = (torch.from_numpy(row).double() for row in (model.kept.entities[entity], other.vector))
    moved = (vector - own).norm() / own.norm().clamp(min=1e-12)
    cosine = cosine_similarity(vector, own, dim=0).item()
    changes = _changes(model, entity, other.vector, questions, best)
    return Without(left_out, what, other.done.initializer, cosine, moved.item(), changes)


def _changes(
    model: OpenBundle, entity: int, vector: np.ndarray, questions: Sequence[Question], best: int
) -> list[Change]:
    """What other answers another vector gives."""
    entities = model.kept.entities.copy()
    entities[entity] = vector
    names, other = model.kept.entity_names, OpenBundle(replace(model.kept, entities=entities), model.family)
    found = []
    for question in questions:
        was, now = ([names[row] for row in ranked(one, question)[0][:best].tolist()] for one in (model, other))
        if set(was) != set(now):
            gone, come = [name for name in was if name not in now], [name for name in now if name not in was]
            found.append(Change(question, gone, come))
    return found
