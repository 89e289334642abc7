"""What a folder keeps: an embedding with its names, its known triples, and what was inserted into it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from isi.config import Count, Name, Option, Section, Seed

#: The sentence model whose vectors ship with the product (all but ``glove``).
MODEL = "all-MiniLM-L6-v2"


class WordSource(Section):
    """Where word vectors come from, so that a new phrase can have one of the same kind."""

    #: of vectors that ship with the product or a file: its name or path; of others, what their maker said
    source: str
    #: what of an entity was embedded: definition, phrase, wordnet (phrases with a definition), glove (means of words)
    text: str
    #: the sentence model that made them; null where none is known
    model: str | None


class InsertionRecord(Section):
    """What an entity was inserted by: enough to insert it again."""

    entity: str
    #: head, relation and tail by name
    told: list[tuple[str, str, str]]
    definition: str | None
    #: as it was asked for; null: the best for what was known
    asked: str | None
    options: dict[str, Option]
    seed: Seed
    #: what served, and why
    initializer: str
    why: str
    fallback: str | None


class Manifest(Section):
    """What an embedding is."""

    family: Name
    family_options: dict[str, Option]
    words: WordSource | None
    #: how it was made, in whatever terms its maker has
    made: dict[str, Any]
    #: those of the last rows, in their order
    inserted: list[InsertionRecord]


class EntityInfo(Manifest):
    """``embedding.json``: what an embedding is, and of what size; the SHA-256 of each of the other files."""

    format: Literal["isi embedding"]
    version: Literal[1]
    entities: Count
    relations: Count
    dimension: Count
    triples: Seed
    files: dict[str, str]


@dataclass(frozen=True, eq=False)
class Bundle:
    """An embedding and what is known of what it embeds."""

    about: Manifest
    #: float32 or float64; shapes: (E, d), (R, w)
    entities: np.ndarray
    relations: np.ndarray
    entity_names: list[str]
    #: empty where there is none
    kinds: list[str]
    #: what each is called in words
    phrases: list[str]
    relation_names: list[str]
    #: ids; shape: (T, 3), int64
    triples: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    #: zero where there is none; shape: (E, v), float32; null where no entity has one
    words: np.ndarray | None = None

    def inserted(self) -> Mapping[str, InsertionRecord]:
        """What was inserted, by name."""
        return {one.entity: one for one in self.about.inserted}
