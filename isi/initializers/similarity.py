"""Similarity by words and by relations, and centroids of the most similar entities:
the parts of ISI (section 4).
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.linalg import vector_norm
from torch.nn.functional import normalize, one_hot

from isi.initializers.api import CENTROID, ES, NONE, RS, InitResult, NoRelationMap
from isi.initializers.context import InitContext

#: Maximal E² for which cosines of all pairs, or unit vectors of all entities, are computed.
WHOLE = 2**24

TINY = 1e-12  #: Smallest length that a vector is divided by.

#: Computes weights of known entities, or a mask of indicators, (M, n, E).
Weigh = Callable[[], Tensor]


def word_similarity(context: InitContext) -> Tensor:
    """Cosine of the word vectors of each novel entity and each entity (equation 3);
    shape (M, n, E).
    """
    if len(context.words) ** 2 <= WHOLE:
        return cosines(context.words)[context.novel]  # the same bits whatever the stack
    unit = normalize(context.words, dim=-1)
    return unit[context.novel] @ unit.T


def insert_triple_alpha(context: InitContext) -> Tensor:
    """α of each insert triple, (M, n, I, d): the expected vector of its novel end (equation 4),
    or NoRelationMap.
    """
    if not context.theta0.model.invertible:
        raise NoRelationMap
    return insert_triple_ends(context, context.theta0.model.inverse)


def insert_triple_ends(context: InitContext, to_head: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """Known end u of each insert triple, mapped:
    by ``to_head`` if the novel entity is its head, else uᵀW; as α.
    """
    theta0, models = context.theta0, torch.arange(len(context.novel))[:, None, None]
    known, relation = (
        theta0.entity[models, context.other],
        theta0.relation[models, context.relation],
    )
    as_tail, as_head = theta0.model.transform(known, relation), to_head(known, relation)
    return torch.where(context.novel_is_tail[..., None], as_tail, as_head)


def relational_score(context: InitContext) -> Tensor:
    """Σ_r cos(v_e, ᾱ_r) over relations of insert triples (equation 5), (M, n, E)."""
    theta0, alpha = context.theta0, insert_triple_alpha(context)
    of = one_hot(context.relation, theta0.relation.shape[1]) * context.observed[..., None]
    centroids = torch.einsum("mnir,mnid->mnrd", of.to(alpha.dtype), alpha)  # ᾱ up to its length
    unit, entity = normalize(centroids, dim=-1), theta0.entity
    if entity.shape[1] ** 2 <= WHOLE:
        return torch.einsum("mnrd,med->mne", unit, normalize(entity, dim=-1))
    length: Tensor = vector_norm(entity, dim=-1)
    return unit.sum(2) @ entity.mT / length.clamp(min=TINY)[:, None]  # copies no large table


def mean_relational_score(context: InitContext) -> Tensor:
    """``relational_score`` divided by the number of relations in insert triples: a mean cosine;
    shape (M, n, E).
    """
    number = torch.zeros(*context.novel.shape, context.theta0.relation.shape[1])
    number.scatter_add_(-1, context.relation, context.observed.float())
    return relational_score(context) / (number > 0).sum(-1, keepdim=True).clamp(min=1)


def top_k(score: Tensor, eligible: Tensor, k: int) -> Tensor:
    """The k eligible entities of highest score, ties to the lower id, as a mask;
    shapes (M, n, E).
    """
    ranked = (
        score.masked_fill(~eligible, -torch.inf)
        .sort(dim=-1, descending=True, stable=True)
        .indices[..., :k]
    )
    return torch.zeros_like(score, dtype=torch.bool).scatter(-1, ranked, True) & eligible


def nearest_by_words(context: InitContext, similarity: Tensor, k: int) -> InitResult:
    """ES: centroid of the k entities of highest word similarity, (M, n, E);
    without a word vector, RS.
    """
    return centroid_of_first(
        context,
        words=lambda: top_k(similarity, word_eligible(context), k),
        triples=lambda: top_related(context, k),
    )


def top_related(context: InitContext, k: int) -> Tensor:
    """The k eligible entities of highest ``relational_score``; shape (M, n, E), bool."""
    return top_k(relational_score(context), context.candidates, k)


def weights_or_fallback(context: InitContext, **ways: Weigh) -> tuple[Tensor, Tensor]:
    """Weights or indicators, (M, n, E), by the first of ``ways`` with data, else all known;
    and fallbacks, (M, n).

    The keyword of a way is the data it needs: ``words``, (insert) ``triples``, ``both`` or
    ``nothing``.
    """
    words, triples = has_words(context), has_insert_triples(context)
    has = {
        "words": words,
        "triples": triples,
        "both": words & triples,
        "nothing": torch.ones_like(words),
    }
    chosen, fallback = all_known(context), torch.full(context.novel.shape, CENTROID)
    unserved = torch.ones_like(words)
    for number, (needed, weigh) in enumerate(ways.items()):
        if (has[needed] & unserved).any():
            weights = weigh()
            serves = has[needed] & unserved & (weights != 0).any(-1)
            chosen = torch.where(serves[..., None], weights, chosen)
            fallback = torch.where(
                serves, {"words": ES, "triples": RS}[needed] if number else NONE, fallback
            )
            unserved &= ~serves
    return chosen, fallback


def centroid_of_first(context: InitContext, **ways: Weigh) -> InitResult:
    """The centroid of the indicators by the first of ``ways`` with data
    (see ``weights_or_fallback``).
    """
    return centroid(context, *weights_or_fallback(context, **ways))


def centroid(context: InitContext, indicators: Tensor, fallback: Tensor) -> InitResult:
    """The mean vector of the indicators, a mask of shape (M, n, E) (equation 1)."""
    mask = indicators.to(context.theta0.entity.dtype)
    number = mask.sum(-1, keepdim=True).clamp(min=1)
    return InitResult(
        (mask @ context.theta0.entity) / number, fallback, mask.double() / number, is_centroid=True
    )


def mean_of_first(context: InitContext, **ways: Weigh) -> InitResult:
    """The weighted mean by the first of ``ways`` with data (see ``weights_or_fallback``)."""
    weights, fallback = weights_or_fallback(context, **ways)
    share = weights / weights.sum(-1, keepdim=True, dtype=torch.float64)
    weights = share.to(context.theta0.entity.dtype)
    return InitResult(weights @ context.theta0.entity, fallback, weights)


def all_known(context: InitContext) -> Tensor:
    """All known entities (of its kind, if ``by_kind``) as the indicators of each novel entity;
    (M, n, E), bool.
    """
    return context.of_kind(context.known).expand(-1, context.novel.shape[1], -1)


def same_kind(context: InitContext) -> Tensor:
    """The known entities of the same kind as each novel entity; shape (M, n, E), bool."""
    return (context.kinds == context.kinds[context.novel][..., None]) & context.known[:, None]


def has_words(context: InitContext) -> Tensor:
    """Mask of the novel entities with a word vector; shape (M, n), bool."""
    return context.worded[context.novel]


def has_insert_triples(context: InitContext) -> Tensor:
    """Mask of the novel entities with at least one insert triple; shape (M, n), bool."""
    return context.observed.any(-1)


def word_eligible(context: InitContext) -> Tensor:
    """Mask of the candidates for indicators of ES, which have a word vector;
    shape (M, n or 1, E), bool.
    """
    return context.candidates & context.worded


def cosines(vectors: Tensor) -> Tensor:
    """Cosine of each pair of rows, zero if either row is zero; shape (E, E)."""
    unit = normalize(vectors, dim=-1)
    return unit @ unit.T
