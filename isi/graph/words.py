"""Word vectors of entities, from any word2vec or GloVe file (gensim ``KeyedVectors``)."""

from __future__ import annotations

import codecs
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError, cut, extra, short

if TYPE_CHECKING:
    # elsewhere where it is used, since it takes seconds to import
    from gensim.models import KeyedVectors

#: Largest magnitude of a number in a vector; those of word2vec and GloVe are below 100.
LARGEST = 1e6
START = 4096  #: Bytes that tell the format.


@dataclass(frozen=True)
class WordVectors:
    """A word vector for each phrase."""

    vectors: np.ndarray  #: zero where a phrase has none; shape: (E, w), float32
    #: tokens whose mean vector each phrase has, separated by spaces; None if none
    served_by: list[str | None]


def look_up(words: KeyedVectors, phrases: Sequence[str]) -> WordVectors:
    """The vector of each phrase as one token (words joined by underscores),
    else the mean over words with a vector.
    """
    vectors = np.zeros((len(phrases), words.vector_size), dtype=np.float32)
    served: list[str | None] = []
    for row, phrase in enumerate(phrases):
        whole = [token for token in (phrase, phrase.replace(" ", "_")) if token in words]
        tokens = whole[:1] or [token for token in phrase.split() if token in words]
        served.append(" ".join(tokens) or None)
        if tokens:
            vectors[row] = np.mean([words[token] for token in tokens], axis=0)
    return WordVectors(vectors, served)


def read_vectors(path: Path) -> KeyedVectors:
    """Read word2vec (text or binary) or GloVe vectors; the first bytes tell the format.

    If a token repeats, its first vector counts. InputError for a file that is cut short or broken.
    """
    with extra("words-file"):
        from gensim.models import KeyedVectors
        from smart_open import open as open_any

    logging.getLogger("gensim").setLevel(logging.ERROR)
    try:
        with open_any(path, "rb") as file:
            first, start = file.readline(START), file.read(START)
        header = re.fullmatch(rb"(?:\xef\xbb\xbf)?([0-9]{1,9})[ \t]+[0-9]+\s*", first)
        is_binary = header is not None and not _is_text(start)
        if not is_binary:  # gensim takes a number that is cut for a whole one
            with open_any(path, "rb") as file:
                lines = [(line.endswith(b"\n"), line.rstrip().count(b" ")) for line in file]
            forms = {*lines[1:]} if header else {*lines}
            if len(forms) != 1 or min(forms) < (True, 1):
                raise ValueError("a line is cut, or has too few or too many numbers")
            if header and len(lines) != 1 + int(header[1]):
                raise ValueError("line 1 says another number of vectors")
        words = KeyedVectors.load_word2vec_format(
            str(path), binary=is_binary, no_header=header is None, encoding="utf-8-sig"
        )
    except Exception as error:  # each compression format has its own exceptions
        form = "expected word vectors in word2vec or GloVe format"
        raise InputError(path, "", f"{form} ({cut(str(error))})") from error
    broken = np.flatnonzero(~(np.abs(words.vectors).max(axis=1) <= LARGEST))  # NaN, too
    if len(broken):
        place = f"vector of {short(words.index_to_key[broken[0]])}"
        raise InputError(path, place, f"expected finite |x| up to {LARGEST:,.0f}")
    return words


def _is_text(start: bytes) -> bool:
    """Whether bytes are UTF-8, perhaps cut at the end, without control characters."""
    try:
        text = codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return False
    return re.search(r"[^\t\n\r\x20-\U0010ffff]", text) is None
