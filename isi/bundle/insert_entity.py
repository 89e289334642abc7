"""A new entity in a kept embedding: ``isi.insert`` with all that the folder knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from isi.bundle.indicators import Indicator, as_new, indicators
from isi.bundle.manifest import Bundle, InsertionRecord
from isi.bundle.query import OpenBundle
from isi.config import Option
from isi.graph.graph import HEAD, TAIL
from isi.insertion.api import insert
from isi.insertion.result import Inserted

#: Head, relation and tail by name.
Fact = tuple[str, str, str]


@dataclass(frozen=True, eq=False)
class NewEntity:
    """What is told of a new entity."""

    name: str
    phrase: str
    kind: str
    facts: list[Fact]
    definition: str | None
    #: word vector, as long as those of the others; null where there is none
    vector: np.ndarray | None
    #: null: the best for what is known
    initializer: str | None
    options: Mapping[str, Option]
    seed: int


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """An embedding with a new entity behind the others."""

    model: OpenBundle
    done: Inserted
    record: InsertionRecord

    @property
    def entity(self) -> int:
        return self.done.new[0]

    @property
    def vector(self) -> np.ndarray:
        row: np.ndarray = self.done.entities[self.entity]
        return row

    def indicators(self) -> list[Indicator]:
        """What it was placed by."""
        weights = None if self.done.weights is None else self.done.weights[0]
        given = as_new(self.model, self.entity, self.done.insert_triples)
        return indicators(given, weights, self.done.indicators is not None)


def insert_entity(model: OpenBundle, news: NewEntity) -> InsertedEntity:
    """Insert a new entity; what is known stays as it is.

    Raises:
        InputError: naming the argument of ``isi.insert`` that is wrong.
    """
    kept = model.kept
    words = None
    if kept.words is not None:
        own = np.zeros(kept.words.shape[1], kept.words.dtype) if news.vector is None else news.vector
        words = np.concatenate([kept.words, own[None]])
    done = insert(
        kept.entities, kept.relations, news.facts, new=[news.name], model=model.family,
        entity_names=kept.entity_names, relation_names=kept.relation_names, known_triples=kept.triples,
        words=None if news.vector is None else words, kinds=[*kept.kinds, news.kind],
        initializer=news.initializer, options=news.options, seed=news.seed,
    )  # fmt: skip
    record = InsertionRecord(
        entity=news.name, told=list(dict.fromkeys(news.facts)), definition=news.definition, asked=news.initializer,
        options=dict(news.options), seed=news.seed, initializer=done.initializer, why=done.why,
        fallback=done.fallback[0],
    )  # fmt: skip
    about = kept.about.model_copy(update={"inserted": [*kept.about.inserted, record]})
    after = Bundle(
        about, done.entities, kept.relations, [*kept.entity_names, news.name], [*kept.kinds, news.kind],
        [*kept.phrases, news.phrase], kept.relation_names, np.concatenate([kept.triples, done.insert_triples]), words,
    )  # fmt: skip
    return InsertedEntity(OpenBundle(after, model.family), done, record)


def before(model: OpenBundle, record: InsertionRecord) -> tuple[OpenBundle, NewEntity]:
    """The embedding as it was before an entity was inserted, and what was told of that."""
    kept, entity = model.kept, model.entity_ids[record.entity]
    words = None if kept.words is None else kept.words[entity]
    news = NewEntity(
        record.entity, kept.phrases[entity], kept.kinds[entity], record.told, record.definition,
        words if words is not None and words.any() else None, record.asked, record.options, record.seed,
    )  # fmt: skip
    return without_entities(model, np.arange(entity)), news


def without_entities(model: OpenBundle, rows: np.ndarray) -> OpenBundle:
    """The embedding of some entities alone, ids in their order, and of the triples between them."""
    kept = model.kept
    place = np.full(len(kept.entities), -1)
    place[rows] = np.arange(len(rows))
    ends = place[kept.triples[:, [HEAD, TAIL]]]
    triples = kept.triples[(ends >= 0).all(1)].copy()
    triples[:, [HEAD, TAIL]] = ends[(ends >= 0).all(1)]
    names = [kept.entity_names[row] for row in rows]
    inserted = [one for one in kept.about.inserted if one.entity in set(names)]
    part = replace(
        kept, about=kept.about.model_copy(update={"inserted": inserted}), entities=kept.entities[rows],
        entity_names=names, kinds=[kept.kinds[row] for row in rows], phrases=[kept.phrases[row] for row in rows],
        triples=triples, words=None if kept.words is None else kept.words[rows],
    )  # fmt: skip
    return OpenBundle(part, model.family)
