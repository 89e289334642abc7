"""Similarity by words and by relations, and centroids of the most similar (section 4): what initializers share."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import normalize, one_hot

from isi.initializers.api import CENTROID, ES, NONE, RS, InitContext, InitResult

#: Numbers in a table of the cosines of every two entities, up to which it is made as a whole.
WHOLE = 2**24


def word_similarity(insertion: InitContext) -> Tensor:
    """Cosine of the word vectors of each novel entity and each entity (equation 3); shape (M, n, E)."""
    if len(insertion.words) ** 2 <= WHOLE:
        return cosines(insertion.words)[insertion.novel]  # the same bits whatever the stack
    unit = normalize(insertion.words, dim=-1)
    return unit[insertion.novel] @ unit.T


def resultants(insertion: InitContext) -> Tensor:
    """α of each insert triple (equation 4); shape (M, n, I, d)."""
    theta0 = insertion.theta0
    models = torch.arange(len(insertion.novel))[:, None, None]
    return theta0.resultants(
        theta0.entity[models, insertion.other], theta0.relation[models, insertion.relation], insertion.novel_is_tail
    )


def relational_score(insertion: InitContext, alpha: Tensor | None = None) -> Tensor:
    """Σ_r cos(v_e, ᾱ_r) over the relations of the insert triples (equation 5); shape (M, n, E).

    Args:
        alpha: in place of the insert triples' own α; shape (M, n, I, d).
    """
    theta0, alpha = insertion.theta0, resultants(insertion) if alpha is None else alpha
    of = one_hot(insertion.relation, theta0.relation.shape[1]) * insertion.observed[..., None]
    centroids = torch.einsum("mnir,mnid->mnrd", of.to(alpha.dtype), alpha)  # ᾱ, but for its length
    return torch.einsum("mnrd,med->mne", normalize(centroids, dim=-1), normalize(theta0.entity, dim=-1))


def top_k(score: Tensor, eligible: Tensor, k: int) -> Tensor:
    """The k eligible entities of highest score, ties to the lower id, as a mask; shapes (M, n, E)."""
    ranked = score.masked_fill(~eligible, -torch.inf).sort(dim=-1, descending=True, stable=True).indices[..., :k]
    return torch.zeros_like(score, dtype=torch.bool).scatter(-1, ranked, True) & eligible


def nearest_by_words(insertion: InitContext, similarity: Tensor, k: int) -> InitResult:
    """Centroid of the k entities of highest word similarity, (M, n, E); RS where there is no word vector."""
    return first_that_can(
        insertion,
        (NONE, has_words(insertion), top_k(similarity, word_eligible(insertion), k)),
        (RS, has_insert_triples(insertion), top_k(relational_score(insertion), insertion.eligible[:, None], k)),
    )


def nearest_by_both(insertion: InitContext, k: int, candidates: int) -> InitResult:
    """RS among the best of ES (equation 6); whichever half there is where the other is missing."""
    words, triples = has_words(insertion), has_insert_triples(insertion)
    similar, related = word_similarity(insertion), relational_score(insertion)
    preliminary = top_k(similar, word_eligible(insertion), candidates)
    return first_that_can(
        insertion,
        (NONE, words & triples, top_k(related, preliminary, k)),
        (RS, triples, top_k(related, insertion.eligible[:, None], k)),
        (ES, words, top_k(similar, word_eligible(insertion), k)),
    )


def first_that_can(insertion: InitContext, *ways: tuple[int, Tensor, Tensor]) -> InitResult:
    """The centroid of the indicators of the first way that can serve a novel entity (see ``first_able``)."""
    return at_centroid(insertion, *first_able(insertion, *ways))


def first_able(insertion: InitContext, *ways: tuple[int, Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Of ways (code, which novel entities it can serve, indicators or weights), the first that can; else all known.

    Shapes of a way: scalar, (M, n), (M, n, E). Codes are indices into ``FALLBACKS``.

    Returns:
        indicators or weights, and the code of whose they are; shapes (M, n, E), (M, n).
    """
    chosen = everyone_known(insertion)
    fallback = torch.full(insertion.novel.shape, CENTROID)
    for code, able, weights in reversed(ways):
        able = able & (weights != 0).any(-1)
        chosen = torch.where(able[..., None], weights, chosen)
        fallback = torch.where(able, code, fallback)
    return chosen, fallback


def at_centroid(insertion: InitContext, indicators: Tensor, fallback: Tensor) -> InitResult:
    """The mean vector of the indicators, a mask of shape (M, n, E) (equation 1)."""
    weight = indicators.to(insertion.theta0.entity.dtype)
    vectors = (weight @ insertion.theta0.entity) / weight.sum(-1, keepdim=True).clamp(min=1)
    return InitResult(vectors, fallback, indicators)


def everyone_known(insertion: InitContext) -> Tensor:
    """All known entities as the indicators of each novel one; shape (M, n, E), bool."""
    return insertion.known[:, None].expand(-1, insertion.novel.shape[1], -1)


def same_kind(insertion: InitContext) -> Tensor:
    """The known entities of each novel one's kind; shape (M, n, E), bool."""
    return (insertion.kinds == insertion.kinds[insertion.novel][..., None]) & insertion.known[:, None]


def has_words(insertion: InitContext) -> Tensor:
    """Novel entities with a word vector; shape (M, n), bool."""
    return (insertion.words != 0).any(-1)[insertion.novel]


def has_insert_triples(insertion: InitContext) -> Tensor:
    """Novel entities with at least one insert triple; shape (M, n), bool."""
    return insertion.observed.any(-1)


def word_eligible(insertion: InitContext) -> Tensor:
    """Entities that may be indicators of ES: eligible ones with a word vector; shape (M, 1, E), bool."""
    return (insertion.eligible & (insertion.words != 0).any(-1))[:, None]


def cosines(vectors: Tensor) -> Tensor:
    """Cosine of each pair of rows, zero where one is zero; shape (E, E)."""
    unit = normalize(vectors, dim=-1)
    return unit @ unit.T
