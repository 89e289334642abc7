"""ES, entity similarity: near what goes by a similar name."""

from __future__ import annotations

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.similarity import nearest_by_words, word_similarity


@initializer("es", label="ES", role="isi", colour="#0072b2")
def entity_similarity(insertion: Insertion, k: Count) -> Initial:
    """Centroid of the k entities of nearest word vectors (equations 2 and 3)."""
    return nearest_by_words(insertion, word_similarity(insertion), k)
