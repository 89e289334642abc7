"""Gaussian: the centre and the spread of what is known, without meaning (a control)."""

from __future__ import annotations

from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion, unaided
from isi.insertion.drawing import known_moments, standard_normal


@initializer("gaussian", label="Gaussian", role="control", colour="#a58fbf")
def gaussian(insertion: Insertion) -> Initial:
    """Normal with the mean and the deviation of each coordinate over the known vectors."""
    centre, deviation = known_moments(insertion)
    return unaided(centre + deviation * standard_normal(insertion))
