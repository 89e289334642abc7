"""Soft RS: all known entities, weighed by how near they are to where the insert triples put the novel one."""

from __future__ import annotations

from isi.base.params import Positive
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import has_insert_triples
from isi.insertion.weighing import first_weighted, mean_relational_score, soft


@initializer("soft_rs", label="Soft RS", role="baseline", colour="#4cc2a0")
def soft_relational_similarity(insertion: Insertion, temperature: Positive) -> Initial:
    """Mean by softmax(score / temperature), the score of equation 5 over the number of relations seen."""
    weights = soft(mean_relational_score(insertion) / temperature, insertion.eligible[:, None])
    return first_weighted(insertion, (NONE, has_insert_triples(insertion), weights))
