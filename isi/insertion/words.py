"""Word vectors of entities: as a user has them, or of texts by whatever makes vectors of texts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isi.errors import InputError, short
from isi.insertion.arguments import Names, array, table

#: What makes vectors of texts: a function, word vectors of gensim's, or a file of such.
Source = Callable[[Sequence[str]], Any] | str | Path
PLACE = "argument 'words'"


def word_table(words: Any, source: Source | None, entities: Names) -> np.ndarray | None:
    """Word vectors of known and new entities, zero where there is none, (E, w), float32; null where none is given.

    Args:
        words: such a table; or, by name or id of an entity, its vector, or a text (a phrase, or a phrase with its
            definition).
        source: what makes vectors of texts.

    Raises:
        InputError: where vectors are of several lengths or not finite, an entity is unknown, or a text has no source.
    """
    if words is None:
        return None
    if not isinstance(words, Mapping):
        found = table(words, "words")
        if len(found) != entities.number:
            expected = f"expected {entities.number} rows, of known and new entities, got {len(found)}"
            raise InputError(PLACE, "", expected)
        with np.errstate(over="ignore"):
            return table(found.astype(np.float32), "words")
    rows = {entities.id(name, PLACE): value for name, value in words.items()}
    texts = {row: value for row, value in rows.items() if isinstance(value, str)}
    vectors = {
        row: array(value, f"{PLACE}: {entities.of(row)!r:.80}", "expected a vector or a text", np.float32)
        for row, value in rows.items() if row not in texts
    }  # fmt: skip
    if texts:
        made = embedded(list(texts.values()), source)
        vectors |= dict(zip(texts, made, strict=True))
    return _filled(vectors, entities)


def embedded(texts: Sequence[str], source: Source | None) -> np.ndarray:
    """Vectors of texts, zero where the source knows none; shape (T, w), float32.

    Raises:
        InputError: where there is no source, or it gives something else.
    """
    if source is None:
        raise InputError(PLACE, "", "expected vectors, or the argument 'word_source' that makes vectors of texts")
    if callable(source):
        given = array(source(list(texts)), "argument 'word_source'", "expected it to give vectors", np.float32)
        made = table(given, "word_source")
    else:
        from gensim.models import KeyedVectors  # here, since it takes a second

        from isi.graph.words import look_up, read_vectors

        vectors = read_vectors(Path(source)) if isinstance(source, str | Path) else source
        if not isinstance(vectors, KeyedVectors):
            expected = f"expected a function, gensim's KeyedVectors or a file of such, got {short(source)}"
            raise InputError("argument 'word_source'", "", expected)
        made = look_up(vectors, texts).vectors
    if len(made) != len(texts):
        raise InputError("argument 'word_source'", "", f"expected {len(texts)} vectors, got {len(made)}")
    return made


def _filled(vectors: Mapping[int, np.ndarray], entities: Names) -> np.ndarray | None:
    """A table of some rows."""
    if not vectors:
        return None
    width = next(iter(vectors.values())).size
    found = np.zeros((entities.number, width), dtype=np.float32)
    for row, vector in vectors.items():
        place = f"{PLACE}: {entities.of(row)!r:.80}"
        if vector.shape != (width,):
            raise InputError(place, "", f"expected a vector of {width} numbers, got {vector.shape}")
        if not np.isfinite(vector).all():
            raise InputError(place, "", "expected finite numbers, got NaN or infinity")
        found[row] = vector
    return found
