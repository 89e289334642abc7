"""Word vectors of entities, from any word2vec or GloVe file (gensim ``KeyedVectors``)."""

from __future__ import annotations

import codecs
import hashlib
import logging
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Literal

import numpy as np
from gensim.models import KeyedVectors
from smart_open import open as open_any

from isi.config import Section, Sha256
from isi.errors import InputError, cut, short
from isi.tables import paths

#: What numbers of vectors lie within; those of word2vec and GloVe are below a hundred.
LARGEST = 1e6
#: The most numbers of a vector, and characters of a token.
WIDEST, LONGEST = 100_000, 1_000
#: Bytes of a line of text, and those that are read of binary vectors at once, at most.
LINE = CHUNK = 2**21


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
    try:
        there = path.is_file()
    except OSError as error:
        raise InputError(short(given.source), "", f"expected a file of word vectors ({error.strerror})") from error
    if there:
        check_sha256(path, given.sha256)
        return read_vectors(path)
    if path.suffix or len(path.parts) > 1:
        raise InputError(path, "", "expected a file of word vectors, but there is no such file")
    if given.sha256 is not None:
        expected = "expected null for a gensim download, which nothing checks: download it, and name the file"
        raise InputError(paths.PARAMS, "words.sha256", expected)
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
    try:
        with path.open("rb") as file:
            got = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from error
    if got != expected:
        raise InputError(path, "", f"expected {expected} as its sha256, got {got}")


def read_vectors(path: Path) -> KeyedVectors:
    """Read word2vec (text or binary) or GloVe vectors; the form is seen from the first bytes.

    gensim's own reader believes a last line that is cut short, and what a header says of memory. Of a token that is
    there twice, the first vector stays.

    Raises:
        InputError: naming the line or the vector that is broken.
    """
    try:
        header, binary = _form(path)
        with open_any(path, "rb") as file:
            found = _of_bytes(path, file, *header) if header and binary else _of_lines(path, file, header)
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(path, "", "expected a file of word vectors, but there is no such file") from error
    except Exception as error:  # each kind of compression has faults of its own
        raise InputError(path, "", f"expected word vectors in word2vec or GloVe format ({cut(str(error))})") from error
    if not found.tokens:
        raise InputError(path, "", "expected word vectors in word2vec or GloVe format, got none")
    vectors = np.frombuffer(found.numbers, dtype="<f4").reshape(len(found.tokens), -1)
    largest = np.maximum(vectors.max(axis=1), -vectors.min(axis=1))
    broken = np.flatnonzero(~(largest <= LARGEST))  # what is no number, too
    if len(broken):
        expected = f"expected numbers within {LARGEST:,.0f}, got {largest[broken[0]]:g}"
        raise InputError(path, f"vector of {short(found.tokens[broken[0]])}", expected)
    words = KeyedVectors(vectors.shape[1])
    words.index_to_key, words.vectors = found.tokens, vectors
    words.key_to_index = {token: row for row, token in enumerate(found.tokens)}
    return words


@dataclass
class _VectorsFound:
    """Tokens, each once, and the numbers of their vectors, behind each other in float32 (little endian)."""

    path: Path
    tokens: list[str] = field(default_factory=list)
    numbers: bytearray = field(default_factory=bytearray)
    seen: set[str] = field(default_factory=set)

    def add(self, place: str, token: bytes, numbers: bytes) -> None:
        try:
            name = token.decode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(self.path, place, f"expected a token in UTF-8 ({error})") from error
        if not name or len(name) > LONGEST:
            raise InputError(self.path, place, f"expected a token of 1 to {LONGEST:,} characters, got {short(name)}")
        if name not in self.seen:
            self.seen.add(name)
            self.tokens.append(name)
            self.numbers += numbers


def _form(path: Path) -> tuple[tuple[int, int] | None, bool]:
    """The header (count, dimension), if there is one, and whether vectors are binary."""
    with open_any(path, "rb") as file:
        first, second = file.readline(LINE), file.read(4096)
    found = re.fullmatch(rb"([0-9]{1,9})[ \t]+([0-9]{1,9})\s*", first.removeprefix(codecs.BOM_UTF8))
    if not found:
        return None, False
    count, dimension = (int(number) for number in found.groups())
    if not 0 < dimension <= WIDEST:
        raise InputError(path, "line 1", f"expected a dimension from 1 to {WIDEST:,}, got {dimension}")
    return (count, dimension), not _is_text(second)


def _is_text(start: bytes) -> bool:
    """Whether the bytes after a header are text: vectors in binary hold bytes that no text does."""
    if any(byte < 32 and byte not in b"\t\n\r" for byte in start):
        return False
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        line = start.split(b"\n")[0]
        return b" " in line and all(_is_number(field) for field in line.split()[1:])
    return True


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _of_lines(path: Path, file: IO[bytes], header: tuple[int, int] | None) -> _VectorsFound:
    """Of text: a line for each token, with its numbers behind it."""
    found, dimension, count, last = _VectorsFound(path), header[1] if header else None, 0, (0, b"\n")
    for number, line in enumerate(iter(lambda: file.readline(LINE), b""), 1):
        if not line.strip() or (header and number == 1):
            continue
        text = line.removeprefix(codecs.BOM_UTF8 if number == 1 else b"").rstrip(b" \t\r\n")
        pieces = text.split(b" ")
        dimension, count, last = dimension or len(pieces) - 1, count + 1, (number, line)
        behind = max(1, len(pieces) - dimension)  # tokens of GloVe may have spaces, as `. . .` has
        token, values = b" ".join(pieces[:behind]), pieces[behind:]
        try:
            numbers = array("f", map(float, values))
            if b"_" in text[len(token) :]:
                raise ValueError("Python takes 1_0 for ten")
        except ValueError as error:
            raise InputError(path, f"line {number}", f"expected a token and numbers ({str(error)[:80]})") from error
        if len(values) != dimension or not values or any(not one or _is_number(one) for one in pieces[1:behind]):
            expected = f"expected a token and {dimension or 'its'} numbers, got {len(pieces) - 1} of them"
            raise InputError(path, f"line {number}", expected)
        found.add(f"line {number}", token, numbers.tobytes())
    if header and count != header[0]:
        raise InputError(path, "line 1", f"promises {header[0]} vectors, but the file has {count}")
    if not last[1].endswith(b"\n"):
        raise InputError(path, f"line {last[0]}", "is cut short: expected a line end behind the last vector")
    return found


def _of_bytes(path: Path, file: IO[bytes], count: int, dimension: int) -> _VectorsFound:
    """Of bytes: each token, a space, and its numbers; perhaps a line end."""
    file.readline(LINE)
    found, size, chunk, start = _VectorsFound(path), 4 * dimension, b"", 0
    for number in range(1, count + 1):
        while (end := chunk.find(b" ", start)) < 0 or len(chunk) < end + 1 + size:
            more = file.read(CHUNK)
            if not more or len(chunk) - start > CHUNK:
                expected = f"expected {count} vectors of {dimension} numbers, as line 1 says; this one is not whole"
                raise InputError(path, f"vector {number}", expected)
            chunk, start = chunk[start:] + more, 0
        found.add(f"vector {number}", chunk[start:end].lstrip(b"\n"), chunk[end + 1 : end + 1 + size])
        start = end + 1 + size
    if (chunk[start:] + file.read(CHUNK)).strip(b"\r\n"):
        raise InputError(path, "line 1", f"{count} vectors of dimension {dimension} do not fill the file")
    return found
