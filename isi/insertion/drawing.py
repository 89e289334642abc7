"""Random vectors for novel entities, and the moments of the known ones: what initializers share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor

from isi.base.streams import stream
from isi.insertion.core import Insertion


def drawn(insertion: Insertion, purpose: str, draw: Callable[[Generator, tuple[int, int]], np.ndarray]) -> Tensor:
    """Numbers drawn from one stream for each model; shape (M, n, d)."""
    shape = (insertion.novel.shape[1], insertion.theta0.entity.shape[-1])
    numbers = [draw(stream(insertion.root, purpose, *key), shape) for key in insertion.keys.tolist()]
    return torch.as_tensor(np.stack(numbers), dtype=torch.float32)


def standard_normal(insertion: Insertion) -> Tensor:
    """The same draws for whoever shapes them; shape (M, n, d)."""
    return drawn(insertion, "gaussian", Generator.standard_normal)


def known_moments(insertion: Insertion) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each coordinate over the known vectors; shapes (M, 1, d)."""
    known = insertion.known[..., None].to(insertion.theta0.entity.dtype)
    number = known.sum(1, keepdim=True)
    centre = (known * insertion.theta0.entity).sum(1, keepdim=True) / number
    variance = (known * (insertion.theta0.entity - centre) ** 2).sum(1, keepdim=True) / number
    return centre, variance.sqrt()
