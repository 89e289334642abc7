"""The initializers that the paper compares: Xavier, IU, and the three of ISI: ES, RS and ERS (sections 4 and 5.3)."""

from __future__ import annotations

import torch
from numpy.random import Generator

from isi.config import Count
from isi.initializers.api import InitContext, InitResult, initializer, without_weights
from isi.initializers.similarity import (
    centroid_of_first,
    nearest_by_both,
    nearest_by_words,
    relational_score,
    top_k,
    word_similarity,
)


@initializer(
    "xavier", label="Xavier", role="paper", colour="#999999", cost="entities",
    description="Xavier: small random vectors around zero, the usual start of a new row.",
)  # fmt: skip
def xavier(context: InitContext) -> InitResult:
    """U(-6/√d, 6/√d) in each coordinate (section 5.3)."""
    bound = 6 / context.theta0.entity.shape[-1] ** 0.5
    return without_weights(context.draw("xavier", Generator.random) * 2 * bound - bound)


@initializer(
    "iu", label="IU", role="paper", colour="#e69f00", cost="entities",
    description="IU, informed uniform: random vectors within the range of the known ones.",
)  # fmt: skip
def informed_uniform(context: InitContext) -> InitResult:
    """Uniform in the range of each coordinate over the known vectors (equation 10)."""
    known, vectors = context.known[..., None], context.theta0.entity
    low = vectors.masked_fill(~known, torch.inf).amin(1, keepdim=True)
    high = vectors.masked_fill(~known, -torch.inf).amax(1, keepdim=True)
    return without_weights(context.draw("iu", Generator.random) * (high - low) + low)


@initializer(
    "es", label="ES", role="isi", colour="#0072b2", cost="entities", needs=("words",), defaults={"k": 8},
    grid={"k": [1, 2, 3, 4, 6, 8, 12, 18, 30]},
    description="ES, entity similarity: the centroid of the entities whose names are most similar.",
)  # fmt: skip
def entity_similarity(context: InitContext, k: Count) -> InitResult:
    """Centroid of the k entities of nearest word vectors (equations 2 and 3)."""
    return nearest_by_words(context, word_similarity(context), k)


@initializer(
    "rs", label="RS", role="isi", colour="#009e73", cost="entities", needs=("insert_triples", "inverse"),
    defaults={"k": 18}, grid={"k": [1, 2, 4, 8, 12, 18, 30]},
    description="RS, relational similarity: the centroid of the entities nearest to where the insert triples point.",
)  # fmt: skip
def relational_similarity(context: InitContext, k: Count) -> InitResult:
    """Centroid of the k entities nearest to where the insert triples put the novel one (equations 4 and 5)."""
    return centroid_of_first(context, triples=lambda: top_k(relational_score(context), context.eligible[:, None], k))


@initializer(
    "ers", label="ERS", role="isi", colour="#d55e00", cost="entities", needs=("words", "insert_triples", "inverse"),
    defaults={"k": 9, "candidates": 30}, grid={"k": [1, 2, 3, 5, 9, 15], "candidates": [15, 30, 60]},
    description="ERS, hybrid of ES and RS: among the entities whose names are most similar, the best of RS.",
)  # fmt: skip
def hybrid_similarity(context: InitContext, k: Count, candidates: Count) -> InitResult:
    """RS among the best of ES, as many as ``candidates`` (equation 6)."""
    return nearest_by_both(context, k, candidates)
