"""Centred Gaussian: the spread of what is known, around zero (a control)."""

from __future__ import annotations

from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion, unaided
from isi.insertion.drawing import known_moments, standard_normal


@initializer("gaussian_centred", label="Centred Gaussian", role="control", colour="#c79aa6")
def gaussian_centred(insertion: Insertion) -> Initial:
    """The draws of ``gaussian`` around zero, so that nothing but the centre tells the two apart."""
    _, deviation = known_moments(insertion)
    return unaided(deviation * standard_normal(insertion))
