"""IU, informed uniform: random vectors where the known ones lie."""

from __future__ import annotations

import torch
from numpy.random import Generator

from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion, unaided
from isi.insertion.drawing import drawn


@initializer("iu", label="IU", role="paper", colour="#e69f00")
def informed_uniform(insertion: Insertion) -> Initial:
    """Uniform in the range of each coordinate over the known vectors (equation 10)."""
    known, vectors = insertion.known[..., None], insertion.theta0.entity
    low = vectors.masked_fill(~known, torch.inf).amin(1, keepdim=True)
    high = vectors.masked_fill(~known, -torch.inf).amax(1, keepdim=True)
    return unaided(drawn(insertion, "iu", Generator.random) * (high - low) + low)
