"""MAP, prior ERS: the most probable vector given the insert triples, around where ERS puts it."""

from __future__ import annotations

from isi.base.params import Count, Positive
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.evidence import most_probable
from isi.insertion.similarity import nearest_by_both


@initializer("map_ers", label="MAP, ERS", role="baseline", colour="#d6604d")
def map_around_ers(insertion: Insertion, k: Count, candidates: Count, strength: Positive, ratio: Count) -> Initial:
    """MAP with the vector of ERS as the mean of its prior."""
    return most_probable(insertion, nearest_by_both(insertion, k, candidates), strength, ratio)
