"""RS, relational similarity: near what stands in the same relations."""

from __future__ import annotations

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import first_that_can, has_insert_triples, relational_score, top_k


@initializer("rs", label="RS", role="isi", colour="#009e73")
def relational_similarity(insertion: Insertion, k: Count) -> Initial:
    """Centroid of the k entities nearest to where the insert triples put the novel one (equations 4 and 5)."""
    chosen = top_k(relational_score(insertion), insertion.eligible[:, None], k)
    return first_that_can(insertion, (NONE, has_insert_triples(insertion), chosen))
