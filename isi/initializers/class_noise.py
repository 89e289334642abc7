"""Kind mean and noise: somewhere among what is known of the same kind (arXiv 2511.11118)."""

from __future__ import annotations

import torch
from torch import Tensor

from isi.base.params import NotNegative
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.drawing import standard_normal
from isi.insertion.similarity import at_centroid, first_able, same_kind


@initializer("class_noise", label="Kind mean + noise", role="baseline", colour="#a6761d")
def class_noise(insertion: Insertion, fraction: NotNegative) -> Initial:
    """Kind mean + fraction · σ · N(0, 1), with the kind's deviation σ of each coordinate (see ``kind_mean``)."""
    everyone = torch.ones_like(insertion.novel, dtype=torch.bool)
    kind, fallback = first_able(insertion, (NONE, everyone, same_kind(insertion)))
    noise = fraction * deviation(insertion, kind) * standard_normal(insertion)
    return Initial(at_centroid(insertion, kind, fallback).vectors + noise, fallback)


def deviation(insertion: Insertion, among: Tensor) -> Tensor:
    """Deviation of each coordinate among some entities, a mask of shape (M, n, E); shape (M, n, d)."""
    weight, entity = among.double(), insertion.theta0.entity.double()
    weight /= weight.sum(-1, keepdim=True)
    return (weight @ entity.square() - (weight @ entity).square()).clamp(min=0).sqrt().float()
