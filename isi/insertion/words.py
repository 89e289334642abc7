"""Word vectors of entities: given as vectors, or made of texts by a function, a file, or gensim's vectors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isi.errors import InputError, short
from isi.insertion.arguments import Names, argument, array, table

#: What makes vectors of texts: a function, word vectors of gensim's, or a file of such.
Source = Callable[[Sequence[str]], Any] | str | Path


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
        rows = table(words, "words")
        if len(rows) != entities.number:
            expected = f"expected {entities.number} rows, of known and new entities, got {len(rows)}"
            raise InputError("argument 'words'", "", expected)
        with np.errstate(over="ignore"):
            return table(rows.astype(np.float32), "words")
    with argument("words"):
        by_id = {entities.id(name, ""): value for name, value in words.items()}
        texts = {row: value for row, value in by_id.items() if isinstance(value, str)}
        vectors = {
            row: array(value, "", f"{entities.of(row)!r:.80}: expected a vector or a text", np.float32)
            for row, value in by_id.items() if row not in texts
        }  # fmt: skip
        if texts:
            vectors |= dict(zip(texts, embedded(list(texts.values()), source), strict=True))
        return _as_table(vectors, entities) if vectors else None


def embedded(texts: Sequence[str], source: Source | None) -> np.ndarray:
    """Vectors of texts, zero where the source knows none; shape (T, w), float32.

    Raises:
        InputError: where there is no source, or it gives something else.
    """
    place = "argument 'word_source'"
    if source is None:
        raise InputError("", "", "expected vectors, or the argument 'word_source' that makes vectors of texts")
    if callable(source):
        vectors = array(source(list(texts)), place, "expected it to give vectors", np.float32)
        vectors = table(vectors, "word_source")
    else:
        from gensim.models import KeyedVectors  # here, since it takes a second

        from isi.graph.words import look_up, read_vectors

        keyed = read_vectors(Path(source)) if isinstance(source, str | Path) else source
        if not isinstance(keyed, KeyedVectors):
            expected = f"expected a function, gensim's KeyedVectors or a file of such, got {short(source)}"
            raise InputError(place, "", expected)
        vectors = look_up(keyed, texts).vectors
    if len(vectors) != len(texts):
        raise InputError(place, "", f"expected {len(texts)} vectors, got {len(vectors)}")
    return vectors


def _as_table(vectors: Mapping[int, np.ndarray], entities: Names) -> np.ndarray:
    """A table of some rows; the others are zero."""
    width = next(iter(vectors.values())).size
    rows = np.zeros((entities.number, width), dtype=np.float32)
    for row, vector in vectors.items():
        if vector.shape != (width,):
            expected = f"expected a vector of {width} numbers, got {vector.shape}"
            raise InputError("", f"{entities.of(row)!r:.80}", expected)
        if not np.isfinite(vector).all():
            raise InputError("", f"{entities.of(row)!r:.80}", "expected finite numbers, got NaN or infinity")
        rows[row] = vector
    return rows
