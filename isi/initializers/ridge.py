"""Ridge: the vector whose scores are nearest to 1 for insert triples and 0 for their corruptions."""

from __future__ import annotations

from isi.base.params import Count, Positive
from isi.initializers import initializer
from isi.insertion import evidence
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import everyone_known, first_that_can, has_insert_triples


@initializer("ridge", label="Ridge", role="baseline", colour="#8c6d46")
def ridge(insertion: Insertion, strength: Positive, ratio: Count) -> Initial:
    """Weighted least squares around the centroid of the known (see ``evidence.ridge``); not for distances."""
    prior = first_that_can(insertion, (NONE, has_insert_triples(insertion), everyone_known(insertion)))
    return evidence.ridge(insertion, prior, strength, ratio)
