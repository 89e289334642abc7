"""Soft hybrid: all known entities, weighed by words and by relations, each with its temperature."""

from __future__ import annotations

from isi.base.params import NotNegative
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.weighing import softly_by_both


@initializer("soft_hybrid", label="Soft hybrid", role="baseline", colour="#b8488f")
def soft_hybrid(insertion: Insertion, word_weight: NotNegative, relation_weight: NotNegative) -> Initial:
    """Mean by the softmax of both similarities; a weight is the inverse of a temperature."""
    return softly_by_both(insertion, word_weight, relation_weight)
