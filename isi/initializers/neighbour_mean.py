"""Neighbour mean: the centre of what the insert triples name."""

from __future__ import annotations

from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.evidence import told
from isi.insertion.similarity import has_insert_triples
from isi.insertion.weighing import first_weighted


@initializer("neighbour_mean", label="Neighbour mean", role="baseline", colour="#c9a227")
def neighbour_mean(insertion: Insertion) -> Initial:
    """Mean of the known ends of the insert triples, each as often as they name it."""
    return first_weighted(insertion, (NONE, has_insert_triples(insertion), told(insertion).sum((2, 3))))
