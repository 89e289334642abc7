"""Word vectors of entities, from any word2vec or GloVe file (gensim ``KeyedVectors``)."""

from __future__ import annotations

import codecs
import hashlib
import logging
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from gensim.models import KeyedVectors
from smart_open import open as open_any

from isi.base import paths
from isi.base.errors import InputError
from isi.base.params import Section, Sha256


class Words(Section):
    """Which word vectors to take."""

    source: str
    text: Literal["definition", "phrase", "wordnet", "glove"]
    sha256: Sha256 | None

    @property
    def shipped(self) -> bool:
        """Whether they are those under ``data/raw``."""
        return self.source == "shipped"


@dataclass(frozen=True)
class WordVectors:
    """Word vectors aligned with phrases."""

    #: zero where a phrase has none; shape: (E, w), float32
    vectors: np.ndarray
    #: the tokens that served each phrase, separated by spaces; null where none did
    served_by: list[str | None]


def look_up(words: KeyedVectors, phrases: Sequence[str]) -> WordVectors:
    """Vectors of phrases: as one token, joined by underscores, or the mean of the tokens that are known."""
    vectors = np.zeros((len(phrases), words.vector_size), dtype=np.float32)
    served: list[str | None] = []
    for row, phrase in enumerate(phrases):
        whole = [token for token in (phrase, phrase.replace(" ", "_")) if token in words]
        tokens = whole[:1] or [token for token in phrase.split() if token in words]
        served.append(" ".join(tokens) or None)
        if tokens:
            vectors[row] = np.mean([words[token] for token in tokens], axis=0)
    return WordVectors(vectors, served)


def load_vectors(given: Words) -> KeyedVectors:
    """Load the word vectors that params name: those that ship, or a file, or else a gensim download.

    Raises:
        InputError: where the file is broken or hashes to something else than it should, or there is
            neither such a file nor such a download.
    """
    if given.shipped:
        return read_vectors(paths.shipped_vectors(given.text))
    path = Path(given.source)
    if path.is_file():
        check_sha256(path, given.sha256)
        return read_vectors(path)
    if path.suffix or len(path.parts) > 1:
        raise InputError(path, "", "expected a file of word vectors, but there is no such file")
    import gensim.downloader  # asks the network, so only where params ask for it

    logging.getLogger("gensim").setLevel(logging.ERROR)
    try:
        found = gensim.downloader.load(given.source)
    except Exception as error:  # gensim lets every fault of the network and of its index through as it is
        expected = f"neither a file nor a gensim download that can be reached ({type(error).__name__})"
        raise InputError(given.source, "", expected) from error
    if not isinstance(found, KeyedVectors):
        raise InputError(given.source, "", "a gensim download, but holds no word vectors")
    return found


def check_sha256(path: Path, expected: str | None) -> None:
    """Refuse a file that hashes to something else than expected, if anything is."""
    if expected is None:
        return
    with path.open("rb") as file:
        got = hashlib.file_digest(file, "sha256").hexdigest()
    if got != expected:
        raise InputError(path, "", f"expected {expected} as its sha256, got {got}")


def read_vectors(path: Path) -> KeyedVectors:
    """Read word2vec (text or binary) or GloVe vectors; the form is seen from the first bytes.

    Raises:
        InputError: naming the line or the vector that is broken.
    """
    try:
        header, binary = _form(path)
        words = KeyedVectors.load_word2vec_format(str(path), binary=binary, no_header=header is None)
    except (ValueError, TypeError, EOFError, OSError, OverflowError, MemoryError, zlib.error) as error:
        place = "" if isinstance(error, OSError) else _broken_place(path)
        raise InputError(path, place, f"expected word vectors in word2vec or GloVe format ({error})") from error
    if not words.vectors.size:
        raise InputError(path, "", "expected word vectors in word2vec or GloVe format, got none")
    if not np.isfinite(words.vectors).all():
        token = words.index_to_key[int(np.flatnonzero(~np.isfinite(words.vectors).all(1))[0])]
        raise InputError(path, f"vector of {token!r}", "expected finite numbers")
    if header and binary:
        _check_length(path, words, header)
    return words


def _form(path: Path) -> tuple[tuple[int, int] | None, bool]:
    """The header (count, dimension), if there is one, and whether vectors are binary."""
    with open_any(path, "rb") as file:
        first, second = file.readline(), file.read(4096)
    fields = first.split()
    if len(fields) != 2 or not all(field.isdigit() for field in fields):
        first.decode("utf-8")
        return None, False
    count, dimension = (int(field) for field in fields)
    return (count, dimension), not _is_text(second)


def _is_text(start: bytes) -> bool:
    """Whether the bytes after a header are text: vectors in binary hold bytes that no text does."""
    if any(byte < 32 and byte not in b"\t\n\r" for byte in start):
        return False
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        line = start.split(b"\n")[0]
        return b" " in line and all(_is_number(field.decode("latin-1")) for field in line.split()[1:])
    return True


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return not text
    return True


def _check_length(path: Path, words: KeyedVectors, header: tuple[int, int]) -> None:
    """Refuse a binary file that goes on after its last vector: its header gives a wrong dimension."""
    count, dimension = header
    with open_any(path, "rb") as file:
        start = len(file.readline())
        size = file.seek(0, 2) - start
    longest = sum(len(key.encode()) for key in words.index_to_key if key) + count * (4 * dimension + 2)
    if None not in words.index_to_key and size > longest:
        raise InputError(path, "line 1", f"{count} vectors of dimension {dimension} do not fill the file")


def _broken_place(path: Path) -> str:
    """The first line of a text file whose numbers are not those of the lines before it."""
    try:
        header, binary = _form(path)
        if binary:
            return "binary vectors"
        with open_any(path, encoding="utf-8") as file:
            return next(_broken_lines(file, header), "end of file")
    except (ValueError, EOFError, OSError, zlib.error):
        return ""


def _broken_lines(lines: Iterator[str], header: tuple[int, int] | None) -> Iterator[str]:
    dimension = header[1] if header else None
    for number, line in enumerate(lines, 1):
        if header and number == 1:
            continue
        values = line.rstrip().split(" ")[1:]
        dimension = dimension or len(values)
        if len(values) != dimension or not all(value and _is_number(value) for value in values):
            yield f"line {number}"
