"""Soft ES: all known entities, weighed by how near their word vectors are."""

from __future__ import annotations

from isi.base.params import Positive
from isi.initializers import initializer
from isi.insertion.core import NONE, RS, Initial, Insertion
from isi.insertion.similarity import has_insert_triples, has_words, word_eligible, word_similarity
from isi.insertion.weighing import first_weighted, mean_relational_score, soft


@initializer("soft_es", label="Soft ES", role="baseline", colour="#56a3d9")
def soft_entity_similarity(insertion: Insertion, temperature: Positive) -> Initial:
    """Mean by softmax(cos / temperature) of word vectors (Nadaraya and Watson's estimate; ConSE); else soft RS."""
    return first_weighted(
        insertion,
        (NONE, has_words(insertion), soft(word_similarity(insertion) / temperature, word_eligible(insertion))),
        (RS, has_insert_triples(insertion),
         soft(mean_relational_score(insertion) / temperature, insertion.eligible[:, None])),
    )  # fmt: skip
