"""Projection: a linear map from word vectors to vectors of entities, learned on what is known (DeViSE)."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor
from torch.linalg import solve
from torch.nn.functional import normalize

from isi.base.params import Positive
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import everyone_known, first_that_can, has_words, word_eligible


@initializer("projection", label="Projection", role="baseline", colour="#e377c2")
def projection(insertion: Insertion, penalty: Positive) -> Initial:
    """Ridge regression from word vectors of unit length; the centroid where there is none."""
    able = has_words(insertion) & word_eligible(insertion).any(-1)
    otherwise = first_that_can(insertion, (NONE, able, everyone_known(insertion)))
    vectors = predicted(insertion, penalty).to(otherwise.vectors.dtype)
    return replace(otherwise, vectors=torch.where(able[..., None], vectors, otherwise.vectors), indicators=None)


def predicted(insertion: Insertion, penalty: float) -> Tensor:
    """ȳ + (x - x̄)ᵀB, where B makes Σ ‖y - ȳ - Bᵀ(x - x̄)‖² + ``penalty`` ‖B‖² least; shape (M, n, d), float64."""
    weight = word_eligible(insertion)[:, 0, :, None].double()
    words, entity = normalize(insertion.words.double(), dim=-1), insertion.theta0.entity.double()
    number = weight.sum(1, keepdim=True).clamp(min=1)
    from_words, to_entity = ((weight * table).sum(1, keepdim=True) / number for table in (words, entity))
    inputs, outputs = weight * (words - from_words), weight * (entity - to_entity)
    slopes: Tensor = solve(inputs.mT @ inputs + penalty * torch.eye(words.shape[-1]), inputs.mT @ outputs)
    return to_entity + (words[insertion.novel] - from_words) @ slopes
