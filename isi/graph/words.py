"""Word vectors of entities, from any word2vec or GloVe file (gensim ``KeyedVectors``)."""

from __future__ import annotations

import codecs
import logging
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Literal

import numpy as np

from isi.config import Section, Sha256
from isi.errors import InputError, at, cut, extra, short
from isi.tables import paths
from isi.tables.io import check_sha256
from isi.tables.rules import TEXT, ColumnType
from isi.tables.table import Table, TensorFile

if TYPE_CHECKING:
    # elsewhere where it is used, since it takes seconds to import
    from gensim.models import KeyedVectors

#: Tensor ``vectors``, shape (E, w), float32; zeros where an entity has no word vector.
WORD_VECTORS = TensorFile("data/words/{experiment}/vectors.safetensors")
#: The phrase of each entity, and the tokens whose vectors it has (``WordVectors.served_by``).
COVERAGE = Table(
    "data/words/{experiment}/coverage.parquet",
    key=["entity"],
    columns={"entity": TEXT, "phrase": TEXT, "served_by": ColumnType(TEXT.type, nullable=True)},
)

#: Largest magnitude of a number in a vector; those of word2vec and GloVe are below 100.
LARGEST = 1e6
#: Maximal dimension of a vector, and length of a token in characters.
WIDEST, LONGEST = 100_000, 1_000
CHUNK = 2**21  #: Maximal bytes of a line of text; binary vectors are read in chunks of this size.


class Words(Section):
    """``words`` in params: which word vectors to use."""

    source: str
    text: Literal["definition", "phrase", "wordnet", "glove"]
    sha256: Sha256 | None

    @property
    def shipped(self) -> bool:
        """Whether these are the vectors under ``data/raw``."""
        return self.source == "shipped"


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


def load_vectors(given: Words) -> KeyedVectors:
    """Load the word vectors that params name: shipped, from a file, or a gensim download;
    InputError if that fails.
    """
    if given.shipped:
        return read_vectors(paths.shipped_vectors(given.text))
    path = Path(given.source)
    with at(short(given.source)):
        is_file = path.is_file()
    if is_file:
        check_sha256(path, given.sha256)
        return read_vectors(path)
    if path.suffix or len(path.parts) > 1:
        raise InputError(path, "", "expected a file of word vectors, but there is no such file")
    if given.sha256 is not None:
        expected = (
            "expected null or a file as words.source, since only the SHA-256 of a file is checked"
        )
        raise InputError(paths.PARAMS, "words.sha256", expected)
    with extra("words-file"):
        import gensim.downloader  # needs the network: imported only for a download

    logging.getLogger("gensim").setLevel(logging.ERROR)
    try:
        downloaded = gensim.downloader.load(given.source)
    except Exception as error:  # gensim does not wrap errors of the network or of its index
        expected = (
            f"neither a file nor a gensim download that can be reached ({type(error).__name__})"
        )
        raise InputError(given.source, "", expected) from error
    if not hasattr(downloaded, "key_to_index"):
        raise InputError(given.source, "", "this gensim download holds no word vectors")
    return downloaded


def read_vectors(path: Path) -> KeyedVectors:
    """Read word2vec (text or binary) or GloVe vectors; the first bytes tell the format.

    gensim's own reader is not used: it accepts a truncated last line and trusts the header's size.
    If a token repeats, its first vector counts. InputError names the broken line or vector.
    """
    with extra("words-file"):
        from gensim.models import KeyedVectors

    rows, numbers = dict[str, int](), bytearray()
    form = "expected word vectors in word2vec or GloVe format"
    try:
        with at(path):
            for unit, number, token, values in _entries(path):
                with at("", f"{unit} {number}"):
                    name = token.decode()
                    if not 0 < len(name) <= LONGEST:
                        raise InputError(
                            "",
                            "",
                            f"expected a token of 1 to {LONGEST:,} characters, got {short(name)}",
                        )
                if name not in rows:
                    rows[name] = len(rows)
                    numbers += values
    except InputError:
        raise
    except Exception as error:  # each compression format has its own exceptions
        raise InputError(path, "", f"{form} ({cut(str(error))})") from error
    if not rows:
        raise InputError(path, "", f"{form}, got none")
    words = KeyedVectors(len(numbers) // 4 // len(rows))
    words.index_to_key, words.key_to_index = list(rows), rows
    words.vectors = np.frombuffer(numbers, dtype="<f4").reshape(len(rows), -1)
    broken = np.flatnonzero(~(np.abs(words.vectors).max(axis=1) <= LARGEST))  # NaN, too
    if len(broken):
        place = f"vector of {short(words.index_to_key[broken[0]])}"
        raise InputError(path, place, f"expected finite |x| up to {LARGEST:,.0f}")
    return words


def _entries(path: Path) -> Iterator[tuple[str, int, bytes, bytes]]:
    """For each vector: its unit (line or vector) and number, its token,
    and its values (float32, little endian).
    """
    with extra("words-file"):
        from smart_open import open as open_any

    with open_any(path, "rb") as file:
        header, start = file.readline(CHUNK), file.read(4096)
    sizes = re.fullmatch(
        rb"([0-9]{1,9})[ \t]+([0-9]{1,9})\s*", header.removeprefix(codecs.BOM_UTF8)
    )
    count, dimension = map(int, sizes.groups()) if sizes else (0, 0)
    if sizes and not 0 < dimension <= WIDEST:
        raise InputError(
            "", "line 1", f"expected a dimension from 1 to {WIDEST:,}, got {dimension}"
        )
    number = 0
    with open_any(path, "rb") as file:
        if sizes:
            file.readline(CHUNK)
        is_binary = sizes and _is_binary(start)
        for entry in (
            _of_bytes(file, dimension)
            if is_binary
            else _of_lines(file, dimension, 2 if sizes else 1)
        ):
            number += 1
            yield entry
    if sizes and number != count:
        raise InputError("", "line 1", f"promises {count} vectors, but the file has {number}")


def _is_binary(start: bytes) -> bool:
    """Whether the bytes after a header are binary vectors:
    they are not UTF-8 or contain control characters.
    """
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return True
    return re.search(rb"[^\t\n\r\x20-\xff]", start) is not None


def _of_lines(
    file: IO[bytes], dimension: int, first: int
) -> Iterator[tuple[str, int, bytes, bytes]]:
    """Entries of a text file, one line each; with dimension 0,
    the first line sets the dimension.
    """
    for number, line in enumerate(iter(partial(file.readline, CHUNK), b""), first):
        text = (line if number > 1 else line.removeprefix(codecs.BOM_UTF8)).rstrip(b" \t\r\n")
        if not text:
            continue
        dimension = dimension or text.count(b" ")
        # tokens of GloVe may have spaces, as `. . .` has
        token, *values = text.rsplit(b" ", dimension)
        row = _numbers(values)
        is_misread = b" " in token and any(
            not word or _numbers([word]) for word in token.split(b" ")[1:]
        )
        if len(row) != max(1, dimension) or is_misread:
            expected = f"expected a token and {dimension or 'its'} numbers, got {short(text[-40:])}"
            raise InputError("", f"line {number}", expected)
        if not line.endswith(b"\n"):
            raise InputError(
                "", f"line {number}", "is cut short: expected a line end after the last vector"
            )
        yield "line", number, token, row.tobytes()


def _numbers(texts: Sequence[bytes]) -> array[float]:
    """Texts as float32; an empty array if one is not a number."""
    try:
        # Python takes 1_0 for ten
        return array("f", map(float, texts if b"_" not in b"".join(texts) else [b"_"]))
    except ValueError:
        return array("f")


def _of_bytes(file: IO[bytes], dimension: int) -> Iterator[tuple[str, int, bytes, bytes]]:
    """Entries of a binary file: a token, a space, its values, and an optional line end."""
    number, rest = 1, b""
    for more in iter(partial(file.read, CHUNK), b""):
        chunk, start = rest + more, 0
        while (end := chunk.find(b" ", start)) >= 0 and len(chunk) > end + 4 * dimension:
            yield (
                "vector",
                number,
                chunk[start:end].lstrip(b"\n"),
                chunk[end + 1 : end + 1 + 4 * dimension],
            )
            number, start = number + 1, end + 1 + 4 * dimension
        rest = chunk[start:]
        if len(rest) > CHUNK:
            break
    if rest.strip(b"\r\n"):
        raise InputError(
            "", f"vector {number}", f"is not whole: expected {dimension} numbers, as line 1 says"
        )
