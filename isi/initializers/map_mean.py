"""MAP, prior mean: the most probable vector given the insert triples, around the centre of what is known."""

from __future__ import annotations

from isi.base.params import Count, Positive
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.evidence import most_probable
from isi.insertion.similarity import everyone_known, first_that_can, has_insert_triples


@initializer("map_mean", label="MAP, mean", role="baseline", colour="#f4a582")
def map_around_mean(insertion: Insertion, strength: Positive, ratio: Count) -> Initial:
    """MAP with the centroid of the known entities as the mean of its prior."""
    prior = first_that_can(insertion, (NONE, has_insert_triples(insertion), everyone_known(insertion)))
    return most_probable(insertion, prior, strength, ratio)
