"""MAP, prior soft hybrid: the most probable vector given the insert triples, around where the soft hybrid puts it."""

from __future__ import annotations

from isi.base.params import Count, NotNegative, Positive
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.evidence import most_probable
from isi.insertion.weighing import softly_by_both


@initializer("map_soft_hybrid", label="MAP, soft hybrid", role="baseline", colour="#b2182b")
def map_around_soft_hybrid(
    insertion: Insertion, word_weight: NotNegative, relation_weight: NotNegative, strength: Positive, ratio: Count
) -> Initial:
    """MAP with the vector of the soft hybrid as the mean of its prior."""
    return most_probable(insertion, softly_by_both(insertion, word_weight, relation_weight), strength, ratio)
