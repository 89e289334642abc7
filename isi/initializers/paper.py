"""Xavier: small random vectors, as new rows of an embedding usually are.

IU, informed uniform: random vectors where the known ones lie.

ES, entity similarity: near what goes by a similar name.

RS, relational similarity: near what stands in the same relations.

ERS, hybrid of ES and RS: of what goes by a similar name, what stands in the same relations.
"""

from __future__ import annotations

import torch
from numpy.random import Generator

from isi.config import Count
from isi.initializers.api import NONE, InitContext, InitResult, initializer, without_indicators
from isi.initializers.controls import drawn
from isi.initializers.similarity import (
    first_that_can,
    has_insert_triples,
    nearest_by_both,
    nearest_by_words,
    relational_score,
    top_k,
    word_similarity,
)


@initializer("xavier", label="Xavier", role="paper", colour="#999999")
def xavier(insertion: InitContext) -> InitResult:
    """U(-6/√d, 6/√d) in each coordinate (section 5.3)."""
    bound = 6 / insertion.theta0.entity.shape[-1] ** 0.5
    return without_indicators(drawn(insertion, "xavier", Generator.random) * 2 * bound - bound)


@initializer("iu", label="IU", role="paper", colour="#e69f00")
def informed_uniform(insertion: InitContext) -> InitResult:
    """Uniform in the range of each coordinate over the known vectors (equation 10)."""
    known, vectors = insertion.known[..., None], insertion.theta0.entity
    low = vectors.masked_fill(~known, torch.inf).amin(1, keepdim=True)
    high = vectors.masked_fill(~known, -torch.inf).amax(1, keepdim=True)
    return without_indicators(drawn(insertion, "iu", Generator.random) * (high - low) + low)


@initializer("es", label="ES", role="isi", colour="#0072b2")
def entity_similarity(insertion: InitContext, k: Count) -> InitResult:
    """Centroid of the k entities of nearest word vectors (equations 2 and 3)."""
    return nearest_by_words(insertion, word_similarity(insertion), k)


@initializer("rs", label="RS", role="isi", colour="#009e73")
def relational_similarity(insertion: InitContext, k: Count) -> InitResult:
    """Centroid of the k entities nearest to where the insert triples put the novel one (equations 4 and 5)."""
    chosen = top_k(relational_score(insertion), insertion.eligible[:, None], k)
    return first_that_can(insertion, (NONE, has_insert_triples(insertion), chosen))


@initializer("ers", label="ERS", role="isi", colour="#d55e00")
def hybrid_similarity(insertion: InitContext, k: Count, candidates: Count) -> InitResult:
    """RS among the best of ES, as many as ``candidates`` (equation 6)."""
    return nearest_by_both(insertion, k, candidates)
