"""What a bundle is: an embedding with its names, its known triples, and a record of each insertion into it."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, ConfigDict, model_validator

from isi.config import Count, Name, Option, Section, Seed

#: The sentence model whose vectors ship with the product (all but ``glove``).
MODEL = "all-MiniLM-L6-v2"
#: Head, relation and tail by name; a list in JSON.
NamedTriple = Annotated[
    tuple[str, str, str], BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
]
#: What version 1 of the format calls some fields.
KEYS = {
    "model_name": "family", "model_options": "family_options", "insert_triples": "told",
    "requested_initializer": "asked",
}  # fmt: skip
#: Categories of characters that break lines or cells, move a terminal's cursor, or are no text.
CONTROL = frozenset({"Cc", "Cs", "Zl", "Zp"})


class ManifestSection(Section):
    """A part of ``embedding.json``."""

    model_config = ConfigDict(alias_generator=lambda name: KEYS.get(name, name))

    @model_validator(mode="before")
    @classmethod
    def _by_key(cls, values: Any) -> Any:
        return {KEYS.get(name, name): value for name, value in values.items()} if isinstance(values, dict) else values


class WordSource(ManifestSection):
    """Where word vectors come from, so that a new phrase can have one of the same kind."""

    #: a file's name or path, ``shipped``, or a description
    source: str
    #: what of an entity was embedded: definition, phrase, wordnet (phrases with a definition), glove (means of words)
    text: str
    #: the sentence model that made them; null where it is unknown
    model: str | None


class InsertionRecord(ManifestSection):
    """How an entity was inserted: enough to insert it again."""

    entity: str
    insert_triples: list[NamedTriple]
    definition: str | None
    #: null: the best for what was given
    requested_initializer: str | None
    options: dict[str, Option]
    seed: Seed
    #: which was used, and why
    initializer: str
    why: str
    fallback: str | None


class Manifest(ManifestSection):
    """What an embedding is."""

    model_name: Name
    model_options: dict[str, Option]
    words: WordSource | None
    #: how it was trained or where it was imported from, in its maker's terms
    made: dict[str, Any]
    #: of the last rows, in their order
    inserted: list[InsertionRecord]


class ManifestFile(Manifest):
    """``embedding.json``: the manifest, the sizes, and the SHA-256 of each other file."""

    format: Literal["isi embedding"]
    version: Literal[1]
    entities: Count
    relations: Count
    dimension: Count
    triples: Seed
    files: dict[str, str]


@dataclass(frozen=True, eq=False)
class Bundle:
    """An embedding and what is known about its entities."""

    manifest: Manifest
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

    def insertions(self) -> Mapping[str, InsertionRecord]:
        """Records by the name of the inserted entity."""
        return {record.entity: record for record in self.manifest.inserted}


def name_fault(name: str) -> str | None:
    """What is wrong with a name of an entity or a relation; null where nothing is."""
    return text_fault(name) if name.strip() else "expected a name, got none"


def text_fault(text: str) -> str | None:
    """What is wrong with a text that is printed or stands in a cell of a table; null where nothing is."""
    if not text.isprintable() and any(unicodedata.category(character) in CONTROL for character in text):
        return f"expected text without tabs, line breaks or other control characters, got {text[:80]!r}"
    return None
