"""A new entity in a bundle: ``isi.insert`` with all that the bundle knows, and a record of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from isi.bundle.indicators import Indicator, indicators
from isi.bundle.manifest import Bundle, InsertionRecord, NamedTriple
from isi.bundle.query import OpenBundle
from isi.config import Option
from isi.graph.graph import HEAD, TAIL
from isi.insertion.api import insert
from isi.insertion.result import Inserted


@dataclass(frozen=True, eq=False)
class NewEntity:
    """What is given about a new entity."""

    name: str
    phrase: str
    kind: str
    insert_triples: list[NamedTriple]
    definition: str | None
    #: word vector, as long as those of the others; null where there is none
    vector: np.ndarray | None
    #: null: the best for what is given
    initializer: str | None
    options: Mapping[str, Option]
    seed: int


@dataclass(frozen=True, eq=False)
class InsertedEntity:
    """A bundle with a new entity in its last row."""

    opened: OpenBundle
    result: Inserted
    record: InsertionRecord

    @property
    def entity(self) -> int:
        """Its id."""
        return self.result.new[0]

    @property
    def vector(self) -> np.ndarray:
        """Shape (d,)."""
        row: np.ndarray = self.result.entities[self.entity]
        return row

    def indicators(self) -> list[Indicator]:
        """The known entities that determined its vector."""
        return indicators(self.result, self.opened.bundle.entity_names, self.opened.bundle.words)


def insert_entity(opened: OpenBundle, new: NewEntity) -> InsertedEntity:
    """Insert a new entity; nothing that is known changes.

    Raises:
        InputError: naming the argument of ``isi.insert`` that is wrong.
    """
    bundle, words = opened.bundle, None
    if bundle.words is not None:
        vector = np.zeros(bundle.words.shape[1], bundle.words.dtype) if new.vector is None else new.vector
        words = np.concatenate([bundle.words, vector[None]])
    result = insert(
        bundle.entities, bundle.relations, new.insert_triples, new=[new.name], model=opened.model,
        entity_names=bundle.entity_names, relation_names=bundle.relation_names, known_triples=bundle.triples,
        words=None if new.vector is None else words, kinds=[*bundle.kinds, new.kind],
        initializer=new.initializer, options=new.options, seed=new.seed,
    )  # fmt: skip
    record = InsertionRecord(
        entity=new.name, insert_triples=list(dict.fromkeys(new.insert_triples)), definition=new.definition,
        requested_initializer=new.initializer, options=dict(new.options), seed=new.seed,
        initializer=result.initializer, why=result.why, fallback=result.fallback[0],
    )  # fmt: skip
    manifest = bundle.manifest.model_copy(update={"inserted": [*bundle.manifest.inserted, record]})
    larger = Bundle(
        manifest, result.entities, bundle.relations, [*bundle.entity_names, new.name], [*bundle.kinds, new.kind],
        [*bundle.phrases, new.phrase], bundle.relation_names,
        np.concatenate([bundle.triples, result.insert_triples]), words,
    )  # fmt: skip
    return InsertedEntity(OpenBundle(larger, opened.model), result, record)


def before(opened: OpenBundle, record: InsertionRecord) -> tuple[OpenBundle, NewEntity]:
    """The bundle before an entity was inserted, and what was given about the entity."""
    bundle, entity = opened.bundle, opened.entity_ids[record.entity]
    words = None if bundle.words is None else bundle.words[entity]
    new = NewEntity(
        record.entity, bundle.phrases[entity], bundle.kinds[entity], record.insert_triples, record.definition,
        words if words is not None and words.any() else None, record.requested_initializer, record.options, record.seed,
    )  # fmt: skip
    return without_entities(opened, np.arange(entity)), new


def without_entities(opened: OpenBundle, rows: np.ndarray) -> OpenBundle:
    """The bundle of the entities ``rows`` alone, ids in their order, and of the triples between them."""
    bundle = opened.bundle
    new_id = np.full(len(bundle.entities), -1)
    new_id[rows] = np.arange(len(rows))
    ends = new_id[bundle.triples[:, [HEAD, TAIL]]]
    triples = bundle.triples[(ends >= 0).all(1)].copy()
    triples[:, [HEAD, TAIL]] = ends[(ends >= 0).all(1)]
    names = [bundle.entity_names[row] for row in rows]
    inserted = [record for record in bundle.manifest.inserted if record.entity in set(names)]
    part = replace(
        bundle, manifest=bundle.manifest.model_copy(update={"inserted": inserted}), entities=bundle.entities[rows],
        entity_names=names, kinds=[bundle.kinds[row] for row in rows], phrases=[bundle.phrases[row] for row in rows],
        triples=triples, words=None if bundle.words is None else bundle.words[rows],
    )  # fmt: skip
    return OpenBundle(part, opened.model)
