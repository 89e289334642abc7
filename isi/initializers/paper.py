"""Initializers of the paper: Xavier, IU and the three of ISI (sections 4 and 5.3);
and controls for them.
"""

import torch
from numpy.random import Generator
from torch import Tensor

from isi.config import Count
from isi.initializers import similarity
from isi.initializers.api import NONE, InitResult, initializer, without_weights
from isi.initializers.context import InitContext
from isi.random import stream


@initializer("xavier", label="Xavier", role="paper")
def xavier(context: InitContext) -> InitResult:
    """Xavier: random vectors around zero, U(-6/√d, 6/√d), of length 3.5 for any d (section 5.3).

    Known vectors are usually shorter, and a long vector outranks them. The usual bound is √6/√d,
    2.4 times smaller.
    """
    bound = 6 / context.theta0.entity.shape[-1] ** 0.5
    return without_weights(context.draw("xavier", Generator.random) * 2 * bound - bound)


@initializer("iu", label="IU", role="paper")
def informed_uniform(context: InitContext) -> InitResult:
    """IU, informed uniform: uniform in each coordinate's range over known vectors,
    longer than most (equation 10).
    """
    known, vectors = context.known[..., None], context.theta0.entity
    low = vectors.masked_fill(~known, torch.inf).amin(1, keepdim=True)
    high = vectors.masked_fill(~known, -torch.inf).amax(1, keepdim=True)
    return without_weights(context.draw("iu", Generator.random) * (high - low) + low)


@initializer(
    "es",
    label="ES",
    role="isi",
    needs=("words",),
    defaults={"k": 8},
    grid={"k": [1, 2, 3, 4, 6, 8, 12, 18, 30]},
)
def entity_similarity(context: InitContext, k: Count) -> InitResult:
    """ES, entity similarity: the centroid of the k entities whose names are most
    similar (equations 2 and 3).
    """
    return similarity.nearest_by_words(context, similarity.word_similarity(context), k)


@initializer(
    "rs",
    label="RS",
    role="isi",
    needs=("insert_triples", "inverse"),
    defaults={"k": 18},
    grid={"k": [1, 2, 4, 8, 12, 18, 30]},
)
def relational_similarity(context: InitContext, k: Count) -> InitResult:
    """RS, relational similarity: the centroid of the k entities that fit the insert
    triples best (equations 4, 5).
    """
    return similarity.centroid_of_first(context, triples=lambda: similarity.top_related(context, k))


@initializer(
    "ers",
    label="ERS",
    role="isi",
    needs=("words", "insert_triples", "inverse"),
    defaults={"k": 9, "candidates": 30},
    grid={"k": [1, 2, 3, 5, 9, 15], "candidates": [15, 30, 60]},
)
def hybrid_similarity(context: InitContext, k: Count, candidates: Count) -> InitResult:
    """ERS, hybrid of ES and RS: RS, with only the entities whose names are most similar
    as candidates (equation 6).
    """
    similar, related = similarity.word_similarity(context), similarity.relational_score(context)
    named, top_k = similarity.word_eligible(context), similarity.top_k
    return similarity.centroid_of_first(
        context,
        both=lambda: top_k(related, top_k(similar, named, candidates), k),
        triples=lambda: top_k(related, context.candidates, k),
        words=lambda: top_k(similar, named, k),
    )


@initializer("mean", label="Mean", role="control", grid={})
def mean(context: InitContext) -> InitResult:
    """Mean: the centroid of all known entities,
    without a choice of indicators (equation 1; a control).
    """
    return similarity.centroid(
        context, similarity.all_known(context), torch.full(context.novel.shape, NONE)
    )


@initializer("kind_mean", label="Kind mean", role="control", grid={})
def kind_mean(context: InitContext) -> InitResult:
    """Kind mean: the centroid of the known entities of the same kind
    (a control: the kind is its only data).
    """
    return similarity.centroid_of_first(context, nothing=lambda: similarity.same_kind(context))


@initializer("gaussian", label="Gaussian", role="control")
def gaussian(context: InitContext) -> InitResult:
    """Gaussian: random vectors with the centre and the spread of the known ones,
    without meaning (a control).
    """
    centre, deviation = known_moments(context)
    drawn = context.draw("gaussian", Generator.standard_normal)
    return without_weights(centre + deviation * drawn)


def known_moments(context: InitContext) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each coordinate over the known vectors; shapes (M, 1, d)."""
    known = context.known[..., None].to(context.theta0.entity.dtype)
    number = known.sum(1, keepdim=True)
    centre = (known * context.theta0.entity).sum(1, keepdim=True) / number
    variance = (known * (context.theta0.entity - centre) ** 2).sum(1, keepdim=True) / number
    return centre, variance.sqrt()


@initializer(
    "es_permuted",
    label="Permuted ES",
    role="control",
    cost="pairs",
    needs=("words",),
    defaults={"k": 8},
)
def permuted_entity_similarity(context: InitContext, k: Count) -> InitResult:
    """Permuted ES: ES after a random permutation of the word vectors among
    all entities (a control).
    """
    dealt = permuted_words(context)
    cosine = similarity.cosines(context.words)[dealt.gather(1, context.novel)]
    return similarity.nearest_by_words(
        context, cosine.gather(-1, dealt[:, None].expand_as(cosine)), k
    )


def permuted_words(context: InitContext) -> Tensor:
    """Entity ids, (M, E), permuted per model among the entities that have a word vector.
    With ``entity_keys``, novel entities keep their own words.
    """
    permuted = context.worded
    if context.entity_keys is not None:  # so that no vector depends on other novel entities
        permuted = permuted & context.known.all(0)
    worded = permuted.nonzero().flatten()
    dealt = torch.arange(len(context.words)).repeat(len(context.novel), 1)
    for model, key in enumerate(context.keys.tolist()):
        rng = stream(context.root, "es_permuted", *key)
        dealt[model, worded] = worded[torch.as_tensor(rng.permutation(len(worded)))]
    return dealt
