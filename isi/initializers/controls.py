"""Random vectors for novel entities, and the moments of the known ones: what initializers share.

Word vectors dealt out at random: what controls without meaning share.

Mean: the centre of what is known, without a choice of indicators (a control).

Kind mean: the centre of what is known of the same kind, what kind alone is worth (a control).

Gaussian: the centre and the spread of what is known, without meaning (a control).

Centred Gaussian: the spread of what is known, around zero (a control).

Permuted ES: centroids as ES takes them, of entities chosen without meaning (a control).

ES permuted within kinds: centroids of entities of the right kind, chosen without meaning (a control).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor

from isi.config import Count
from isi.initializers.api import NONE, InitContext, InitResult, initializer, without_indicators
from isi.initializers.similarity import (
    at_centroid,
    cosines,
    everyone_known,
    first_that_can,
    nearest_by_words,
    same_kind,
)
from isi.random import stream


def drawn(insertion: InitContext, purpose: str, draw: Callable[[Generator, tuple[int, int]], np.ndarray]) -> Tensor:
    """Numbers drawn from one stream for each model; shape (M, n, d)."""
    shape = (insertion.novel.shape[1], insertion.theta0.entity.shape[-1])
    numbers = [draw(stream(insertion.root, purpose, *key), shape) for key in insertion.keys.tolist()]
    return torch.as_tensor(np.stack(numbers), dtype=torch.float32)


def standard_normal(insertion: InitContext) -> Tensor:
    """The same draws for whoever shapes them; shape (M, n, d)."""
    return drawn(insertion, "gaussian", Generator.standard_normal)


def known_moments(insertion: InitContext) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each coordinate over the known vectors; shapes (M, 1, d)."""
    known = insertion.known[..., None].to(insertion.theta0.entity.dtype)
    number = known.sum(1, keepdim=True)
    centre = (known * insertion.theta0.entity).sum(1, keepdim=True) / number
    variance = (known * (insertion.theta0.entity - centre) ** 2).sum(1, keepdim=True) / number
    return centre, variance.sqrt()


def dealt_word_similarity(insertion: InitContext, dealt: Tensor) -> Tensor:
    """``word_similarity``, each entity with the word vector that it is dealt, (M, E); shape (M, n, E)."""
    similarity = cosines(insertion.words)[dealt.gather(1, insertion.novel)]
    return similarity.gather(-1, dealt[:, None].expand_as(similarity))


def dealt_words(insertion: InitContext, purpose: str, groups: Tensor) -> Tensor:
    """Whose word vector each entity is dealt, in each model, among its group; those without one keep none; (M, E).

    Args:
        purpose: of the random streams.
        groups: within which words are dealt; ids, shape (E,).
    """
    wordy = (insertion.words != 0).any(-1)
    members = [(wordy & (groups == group)).nonzero().flatten() for group in torch.unique(groups)]
    dealt = torch.arange(len(insertion.words)).repeat(len(insertion.novel), 1)
    for model, key in enumerate(insertion.keys.tolist()):
        rng = stream(insertion.root, purpose, *key)
        for group in members:
            dealt[model, group] = group[torch.as_tensor(rng.permutation(len(group)))]
    return dealt


@initializer("mean", label="Mean", role="control", colour="#a08a5b")
def mean(insertion: InitContext) -> InitResult:
    """Centroid of all known entities (equation 1)."""
    return at_centroid(insertion, everyone_known(insertion), torch.full(insertion.novel.shape, NONE))


@initializer("kind_mean", label="Kind mean", role="control", colour="#6f8f5b")
def kind_mean(insertion: InitContext) -> InitResult:
    """Centroid of the known entities of the novel one's kind; of all known where there is none."""
    return first_that_can(insertion, (NONE, torch.ones_like(insertion.novel, dtype=torch.bool), same_kind(insertion)))


@initializer("gaussian", label="Gaussian", role="control", colour="#a58fbf")
def gaussian(insertion: InitContext) -> InitResult:
    """Normal with the mean and the deviation of each coordinate over the known vectors."""
    centre, deviation = known_moments(insertion)
    return without_indicators(centre + deviation * standard_normal(insertion))


@initializer("gaussian_centred", label="Centred Gaussian", role="control", colour="#c79aa6")
def gaussian_centred(insertion: InitContext) -> InitResult:
    """The draws of ``gaussian`` around zero, so that nothing but the centre tells the two apart."""
    _, deviation = known_moments(insertion)
    return without_indicators(deviation * standard_normal(insertion))


@initializer("es_permuted", label="Permuted ES", role="control", colour="#8db4cf")
def permuted_entity_similarity(insertion: InitContext, k: Count) -> InitResult:
    """ES with the word vectors dealt out anew among the entities that have one."""
    return nearest_by_words(insertion, dealt_word_similarity(insertion, permuted_words(insertion)), k)


def permuted_words(insertion: InitContext) -> Tensor:
    """Whose word vector each entity is dealt, in each model; shape (M, E)."""
    return dealt_words(insertion, "es_permuted", torch.zeros_like(insertion.kinds))


@initializer("es_permuted_kinds", label="ES permuted within kinds", role="control", colour="#5f7f96")
def permuted_within_kinds(insertion: InitContext, k: Count) -> InitResult:
    """ES with the word vectors dealt out anew among the entities of a kind that have one."""
    dealt = dealt_words(insertion, "es_permuted_kinds", insertion.kinds)
    return nearest_by_words(insertion, dealt_word_similarity(insertion, dealt), k)
