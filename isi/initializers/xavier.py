"""Xavier: small random vectors, as new rows of an embedding usually are."""

from __future__ import annotations

from numpy.random import Generator

from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion, unaided
from isi.insertion.drawing import drawn


@initializer("xavier", label="Xavier", role="paper", colour="#999999")
def xavier(insertion: Insertion) -> Initial:
    """U(-6/√d, 6/√d) in each coordinate (section 5.3)."""
    bound = 6 / insertion.theta0.entity.shape[-1] ** 0.5
    return unaided(drawn(insertion, "xavier", Generator.random) * 2 * bound - bound)
