"""Initializers of the paper: Xavier, IU and the three of ISI (sections 4 and 5.3);
and controls for them.
"""

import torch
from numpy.random import Generator
from torch import Tensor
from torch.linalg import vector_norm

from isi.config import Count
from isi.initializers import similarity
from isi.initializers.api import NONE, InitContext, InitResult, initializer, without_weights
from isi.models.stack import Embedding
from isi.random import stream

#: A coordinate that a map scales by less is dead: ``inverse`` would magnify it too much.
DEAD = 1e-3


@initializer("xavier", label="Xavier", role="paper", colour="#999999")
def xavier(context: InitContext) -> InitResult:
    """Xavier: random vectors around zero, U(-6/√d, 6/√d), of length 3.5 for any d (section 5.3).

    Known vectors are usually shorter, and a long vector outranks them. The usual bound is √6/√d,
    2.4 times smaller.
    """
    bound = 6 / context.theta0.entity.shape[-1] ** 0.5
    return without_weights(context.draw("xavier", Generator.random) * 2 * bound - bound)


@initializer("iu", label="IU", role="paper", colour="#e69f00")
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
    colour="#0072b2",
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
    colour="#009e73",
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
    colour="#d55e00",
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


@initializer("mean", label="Mean", role="control", colour="#a08a5b", grid={})
def mean(context: InitContext) -> InitResult:
    """Mean: the centroid of all known entities,
    without a choice of indicators (equation 1; a control).
    """
    return similarity.centroid(
        context, similarity.all_known(context), torch.full(context.novel.shape, NONE)
    )


@initializer("kind_mean", label="Kind mean", role="control", colour="#6f8f5b", grid={})
def kind_mean(context: InitContext) -> InitResult:
    """Kind mean: the centroid of the known entities of the same kind
    (a control: the kind is its only data).
    """
    return similarity.centroid_of_first(context, nothing=lambda: similarity.same_kind(context))


@initializer("gaussian", label="Gaussian", role="control", colour="#a58fbf")
def gaussian(context: InitContext) -> InitResult:
    """Gaussian: random vectors with the centre and the spread of the known ones,
    without meaning (a control).
    """
    centre, deviation = known_moments(context)
    return without_weights(centre + deviation * standard_normal(context))


@initializer("gaussian_centred", label="Centred Gaussian", role="control", colour="#c79aa6")
def gaussian_centred(context: InitContext) -> InitResult:
    """Centred Gaussian: random vectors around zero with the spread of
    the known ones (a control).
    """
    _, deviation = known_moments(context)
    return without_weights(deviation * standard_normal(context))


def standard_normal(context: InitContext) -> Tensor:
    """Standard normal draws, the same for ``gaussian``, ``gaussian_centred`` and ``class_noise``;
    shape (M, n, d).
    """
    return context.draw("gaussian", Generator.standard_normal)


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
    colour="#8db4cf",
    cost="pairs",
    needs=("words",),
    defaults={"k": 8},
)
def permuted_entity_similarity(context: InitContext, k: Count) -> InitResult:
    """Permuted ES: ES after a random permutation of the word vectors among
    all entities (a control).
    """
    return _es_permuted(context, "es_permuted", torch.zeros_like(context.kinds), k)


@initializer(
    "es_permuted_kinds",
    label="ES permuted within kinds",
    role="control",
    colour="#5f7f96",
    cost="pairs",
    needs=("words",),
    defaults={"k": 8},
)
def permuted_within_kinds(context: InitContext, k: Count) -> InitResult:
    """ES permuted within kinds: ES after a random permutation of the word vectors
    within each kind (a control).
    """
    return _es_permuted(context, "es_permuted_kinds", context.kinds, k)


def _es_permuted(context: InitContext, purpose: str, groups: Tensor, k: int) -> InitResult:
    """ES with permuted word vectors."""
    dealt = permuted_words(context, purpose, groups)
    cosine = similarity.cosines(context.words)[dealt.gather(1, context.novel)]
    return similarity.nearest_by_words(
        context, cosine.gather(-1, dealt[:, None].expand_as(cosine)), k
    )


def permuted_words(context: InitContext, purpose: str, groups: Tensor) -> Tensor:
    """Entity ids, (M, E), permuted per model within each group's entities that have a word vector;
    ``groups``: (E,). With ``entity_keys``, novel entities keep their own words.
    """
    permuted = context.worded
    if context.entity_keys is not None:  # so that no vector depends on other novel entities
        permuted = permuted & context.known.all(0)
    members = [(permuted & (groups == group)).nonzero().flatten() for group in torch.unique(groups)]
    dealt = torch.arange(len(context.words)).repeat(len(context.novel), 1)
    for model, key in enumerate(context.keys.tolist()):
        rng = stream(context.root, purpose, *key)
        for group in members:
            dealt[model, group] = group[torch.as_tensor(rng.permutation(len(group)))]
    return dealt


@initializer(
    "rs_alive",
    label="RS, alive coordinates",
    role="control",
    colour="#7fb8a4",
    needs=("insert_triples", "inverse"),
    defaults={"k": 18},
)
def relational_similarity_alive(context: InitContext, k: Count) -> InitResult:
    """RS, alive coordinates: RS without the coordinates that a relation's map scales
    to nearly zero (a control).
    """
    models = torch.arange(len(context.novel))[:, None, None]
    alpha = (
        similarity.insert_triple_alpha(context) * alive(context.theta0)[models, context.relation]
    )
    return similarity.centroid_of_first(
        context, triples=lambda: similarity.top_related(context, k, alpha)
    )


def alive(theta0: Embedding) -> Tensor:
    """Mask of the coordinates that a relation's map scales by at least ``DEAD``;
    shape (M, R, d), bool.
    """
    relation, axes = theta0.relation[:, :, None], torch.eye(theta0.entity.shape[-1])
    taken = theta0.model.transform(axes, relation) - theta0.model.transform(
        torch.zeros_like(axes), relation
    )
    stretch: Tensor = vector_norm(taken, dim=-1)
    return stretch >= DEAD
