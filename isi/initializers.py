"""Initializers of novel entities: Xavier, informed uniform, ISI's ES, RS and ERS (section 4), and controls.

A control has one thing that ISI has and Xavier has not: the centre of the known vectors, their
spread, both, or centroids of entities chosen without meaning.

An initializer is a function of an ``Insertion`` and its own options that gives an ``Initial``. To
add one, write the function here under ``@initializer("name")``, put the name into
``insert.initializers`` of ``params.yaml`` and its options, if any, into ``initializers.name``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor
from torch.nn.functional import normalize

from isi import paths
from isi.embeddings import analogy
from isi.embeddings.stack import Embedding
from isi.errors import InputError
from isi.params import Option
from isi.streams import stream

#: What an initializer without the knowledge that it needs falls back to.
FALLBACKS = (None, "es", "rs", "centroid")
_NONE, _ES, _RS, _CENTROID = range(4)


@dataclass(frozen=True)
class Insertion:
    """All that an initializer may look at, for a stack of M models and n novel entities each.

    No validation or test triple is in it.
    """

    #: Θ⁰; rows of novel entities are zero
    theta0: Embedding
    #: entities of D⁰; shape: (M, E), bool
    known: Tensor
    #: known entities with a training triple in D⁰, the only ones to serve as indicators; shape: (M, E), bool
    eligible: Tensor
    #: ids; shape: (M, n)
    novel: Tensor
    #: word vectors, zero where there is none; shape: (E, w)
    words: Tensor
    #: the known end, the relation, and whether the novel entity is the tail, of each insert triple,
    #: padded to I; shapes: (M, n, I)
    other: Tensor
    relation: Tensor
    novel_is_tail: Tensor
    #: which of them are triples and not padding; shape: (M, n, I), bool
    observed: Tensor
    #: root of the random streams, and what each model's depend on beside it; shape: (M, K)
    root: int
    keys: Tensor


@dataclass(frozen=True)
class Initial:
    """Vectors of novel entities as inserted."""

    #: shape: (M, n, d)
    vectors: Tensor
    #: index into ``FALLBACKS``; shape: (M, n)
    fallback: Tensor
    #: the entities whose centroid was taken, if one was; shape: (M, n, E), bool
    indicators: Tensor | None = None


Initializer = Callable[..., Initial]
INITIALIZERS: dict[str, Initializer] = {}


def initializer(name: str) -> Callable[[Initializer], Initializer]:
    """Register an initializer under the name that params use."""

    def register(function: Initializer) -> Initializer:
        INITIALIZERS[name] = function
        return function

    return register


def check(name: str, options: dict[str, Option]) -> None:
    """See that an initializer is registered under the name and takes these options.

    Raises:
        InputError: where it is not, or does not.
    """
    if name not in INITIALIZERS:
        known = ", ".join(INITIALIZERS)
        raise InputError(paths.PARAMS, "insert.initializers", f"expected one of {known}, got {name!r}")
    try:
        inspect.signature(INITIALIZERS[name]).bind(None, **options)
    except TypeError as error:
        raise InputError(paths.PARAMS, f"initializers.{name}", str(error)) from error


@initializer("xavier")
def xavier(insertion: Insertion) -> Initial:
    """U(-6/√d, 6/√d) in each coordinate (section 5.3)."""
    bound = 6 / insertion.theta0.entity.shape[-1] ** 0.5
    return _unaided(_drawn(insertion, "xavier", Generator.random) * 2 * bound - bound)


@initializer("iu")
def informed_uniform(insertion: Insertion) -> Initial:
    """Uniform in the range of each coordinate over the known vectors (equation 10)."""
    known, vectors = insertion.known[..., None], insertion.theta0.entity
    low = vectors.masked_fill(~known, torch.inf).amin(1, keepdim=True)
    high = vectors.masked_fill(~known, -torch.inf).amax(1, keepdim=True)
    return _unaided(_drawn(insertion, "iu", Generator.random) * (high - low) + low)


@initializer("es")
def entity_similarity(insertion: Insertion, k: int) -> Initial:
    """Centroid of the k entities of nearest word vectors (equations 2 and 3)."""
    return _by_words(insertion, word_similarity(insertion), k)


@initializer("rs")
def relational_similarity(insertion: Insertion, k: int) -> Initial:
    """Centroid of the k entities nearest to where the insert triples put the novel one (equations 4 and 5)."""
    chosen = top_k(relational_score(insertion), insertion.eligible[:, None], k)
    return _first_that_can(insertion, (_NONE, has_insert_triples(insertion), chosen))


@initializer("ers")
def hybrid_similarity(insertion: Insertion, k: int, candidates: int) -> Initial:
    """RS among the best of ES (equation 6)."""
    words, triples = has_words(insertion), has_insert_triples(insertion)
    similar, related = word_similarity(insertion), relational_score(insertion)
    preliminary = top_k(similar, word_eligible(insertion), candidates)
    return _first_that_can(
        insertion,
        (_NONE, words & triples, top_k(related, preliminary, k)),
        (_RS, triples, top_k(related, insertion.eligible[:, None], k)),
        (_ES, words, top_k(similar, word_eligible(insertion), k)),
    )


@initializer("mean")
def mean(insertion: Insertion) -> Initial:
    """Centroid of all known entities: their centre without a choice (a control)."""
    everyone = insertion.known[:, None].expand(-1, insertion.novel.shape[1], -1)
    return _at_centroid(insertion, everyone, torch.full(insertion.novel.shape, _NONE))


@initializer("gaussian")
def gaussian(insertion: Insertion) -> Initial:
    """Normal with the mean and the deviation of each coordinate over the known vectors (a control)."""
    centre, deviation = known_moments(insertion)
    return _unaided(centre + deviation * _standard_normal(insertion))


@initializer("gaussian_centred")
def gaussian_centred(insertion: Insertion) -> Initial:
    """The same draws around zero, so that nothing but the centre tells the two apart (a control)."""
    _, deviation = known_moments(insertion)
    return _unaided(deviation * _standard_normal(insertion))


@initializer("es_permuted")
def permuted_entity_similarity(insertion: Insertion, k: int) -> Initial:
    """ES with the word vectors dealt out at random among the entities that have one (a control)."""
    return _by_words(insertion, permuted_word_similarity(insertion), k)


def word_similarity(insertion: Insertion) -> Tensor:
    """Cosine of the word vectors of each novel entity and each entity (equation 3); shape (M, n, E)."""
    return _cosines(insertion.words)[insertion.novel]


def permuted_word_similarity(insertion: Insertion) -> Tensor:
    """The same, each entity with the word vector that each model's permutation deals it; shape (M, n, E)."""
    dealt = permuted_words(insertion)
    similarity = _cosines(insertion.words)[dealt.gather(1, insertion.novel)]
    return similarity.gather(-1, dealt[:, None].expand_as(similarity))


def permuted_words(insertion: Insertion) -> Tensor:
    """Whose word vector each entity is dealt, in each model; those without one keep none; shape (M, E)."""
    wordy = (insertion.words != 0).any(-1).nonzero().flatten()
    dealt = torch.arange(len(insertion.words)).repeat(len(insertion.novel), 1)
    for model, key in enumerate(insertion.keys.tolist()):
        order = stream(insertion.root, "es_permuted", *key).permutation(len(wordy))
        dealt[model, wordy] = wordy[torch.from_numpy(order)]
    return dealt


def known_moments(insertion: Insertion) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each coordinate over the known vectors; shapes (M, 1, d)."""
    known = insertion.known[..., None].to(insertion.theta0.entity.dtype)
    number = known.sum(1, keepdim=True)
    centre = (known * insertion.theta0.entity).sum(1, keepdim=True) / number
    variance = (known * (insertion.theta0.entity - centre) ** 2).sum(1, keepdim=True) / number
    return centre, variance.sqrt()


def relational_score(insertion: Insertion) -> Tensor:
    """Σ_r cos(v_e, ᾱ_r) over the relations of the insert triples (equation 5); shape (M, n, E)."""
    theta0 = insertion.theta0
    models = torch.arange(len(insertion.novel))[:, None, None]
    alpha = analogy.resultants(
        theta0.entity[models, insertion.other], theta0.relation[models, insertion.relation], insertion.novel_is_tail
    )
    of = torch.nn.functional.one_hot(insertion.relation, theta0.relation.shape[1]) * insertion.observed[..., None]
    centroids = torch.einsum("mnir,mnid->mnrd", of.to(alpha.dtype), alpha)  # ᾱ, but for its length
    return torch.einsum("mnrd,med->mne", normalize(centroids, dim=-1), normalize(theta0.entity, dim=-1))


def top_k(score: Tensor, eligible: Tensor, k: int) -> Tensor:
    """The k eligible entities of highest score, ties to the lower id, as a mask; shapes (M, n, E)."""
    ranked = score.masked_fill(~eligible, -torch.inf).sort(dim=-1, descending=True, stable=True).indices[..., :k]
    return torch.zeros_like(score, dtype=torch.bool).scatter(-1, ranked, True) & eligible


def centroid(insertion: Insertion, indicators: Tensor) -> Tensor:
    """Mean vector of the indicators, a mask of shape (M, n, E) (equation 1); shape (M, n, d)."""
    weight = indicators.to(insertion.theta0.entity.dtype)
    return (weight @ insertion.theta0.entity) / weight.sum(-1, keepdim=True).clamp(min=1)


def has_words(insertion: Insertion) -> Tensor:
    """Novel entities with a word vector; shape (M, n), bool."""
    return (insertion.words != 0).any(-1)[insertion.novel]


def has_insert_triples(insertion: Insertion) -> Tensor:
    """Novel entities with at least one insert triple; shape (M, n), bool."""
    return insertion.observed.any(-1)


def word_eligible(insertion: Insertion) -> Tensor:
    """Entities that may be indicators of ES: eligible ones with a word vector; shape (M, 1, E), bool."""
    return (insertion.eligible & (insertion.words != 0).any(-1))[:, None]


def _first_that_can(insertion: Insertion, *ways: tuple[int, Tensor, Tensor]) -> Initial:
    """Of ways (code, which novel entities it can serve, indicators), the first that can; else the centroid."""
    chosen = insertion.known[:, None].expand(-1, insertion.novel.shape[1], -1)
    fallback = torch.full(insertion.novel.shape, _CENTROID)
    for code, able, indicators in reversed(ways):
        able = able & indicators.any(-1)
        chosen = torch.where(able[..., None], indicators, chosen)
        fallback = torch.where(able, code, fallback)
    return _at_centroid(insertion, chosen, fallback)


def _by_words(insertion: Insertion, similarity: Tensor, k: int) -> Initial:
    """Centroid of the k entities of highest word similarity, (M, n, E); RS where there is no word vector."""
    return _first_that_can(
        insertion,
        (_NONE, has_words(insertion), top_k(similarity, word_eligible(insertion), k)),
        (_RS, has_insert_triples(insertion), top_k(relational_score(insertion), insertion.eligible[:, None], k)),
    )


def _at_centroid(insertion: Insertion, indicators: Tensor, fallback: Tensor) -> Initial:
    return Initial(centroid(insertion, indicators), fallback, indicators)


def _cosines(vectors: Tensor) -> Tensor:
    """Cosine of each pair of rows, zero where one is zero; shape (E, E)."""
    unit = normalize(vectors, dim=-1)
    return unit @ unit.T


def _standard_normal(insertion: Insertion) -> Tensor:
    return _drawn(insertion, "gaussian", Generator.standard_normal)


def _drawn(insertion: Insertion, purpose: str, draw: Callable[[Generator, tuple[int, int]], np.ndarray]) -> Tensor:
    """Numbers drawn from one stream for each model; shape (M, n, d)."""
    shape = (insertion.novel.shape[1], insertion.theta0.entity.shape[-1])
    drawn = [draw(stream(insertion.root, purpose, *key), shape) for key in insertion.keys.tolist()]
    return torch.as_tensor(np.stack(drawn), dtype=torch.float32)


def _unaided(vectors: Tensor) -> Initial:
    return Initial(vectors, torch.full(vectors.shape[:2], _NONE))
