"""Vectors on a plane: the one on which they vary most, and other vectors turned towards them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Plane:
    """The two axes on which vectors vary most."""

    #: shapes: (d,), (2, d)
    centre: Tensor
    axes: Tensor
    #: share of the vectors' variance on them
    share: float


def plane(vectors: Tensor) -> Plane:
    """The two principal axes of vectors, (N, d), whose largest coordinates are positive."""
    vectors = vectors.double()
    centre = vectors.mean(0)
    _, lengths, axes = torch.linalg.svd(vectors - centre, full_matrices=False)
    largest = axes[:2].gather(1, axes[:2].abs().argmax(1, keepdim=True))
    return Plane(centre, axes[:2] * largest.sign(), float(lengths[:2].square().sum() / lengths.square().sum()))


def on(axes: Plane, vectors: Tensor) -> Tensor:
    """Where vectors, (..., d), lie on a plane; shape (..., 2)."""
    return (vectors.double() - axes.centre) @ axes.axes.T


def turn(vectors: Tensor, onto: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Vectors moved, turned and scaled so that the known ones lie as near to others as they can (Procrustes).

    Args:
        vectors: shape (M, E, d).
        onto: the same.
        known: shape (M, E), bool.

    Returns:
        shape (M, E, d), and the share of the variance of the others that the known ones then have; (M,).
    """
    moved, shares = [], []
    for one, other, own in zip(vectors.double(), onto.double(), known, strict=True):
        centre, target = one[own].mean(0), other[own].mean(0)
        apart, wanted = one[own] - centre, other[own] - target
        left, lengths, right = torch.linalg.svd(apart.T @ wanted)
        scale = lengths.sum() / apart.square().sum()
        moved.append((one - centre) @ left @ right * scale + target)
        shares.append(lengths.sum() * scale / wanted.square().sum())
    return torch.stack(moved), torch.stack(shares)
