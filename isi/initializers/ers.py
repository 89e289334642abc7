"""ERS, hybrid of ES and RS: of what goes by a similar name, what stands in the same relations."""

from __future__ import annotations

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import ES, NONE, RS, Initial, Insertion
from isi.insertion.similarity import (
    first_that_can,
    has_insert_triples,
    has_words,
    relational_score,
    top_k,
    word_eligible,
    word_similarity,
)


@initializer("ers", label="ERS", role="isi", colour="#d55e00")
def hybrid_similarity(insertion: Insertion, k: Count, candidates: Count) -> Initial:
    """RS among the best of ES, as many as ``candidates`` (equation 6)."""
    words, triples = has_words(insertion), has_insert_triples(insertion)
    similar, related = word_similarity(insertion), relational_score(insertion)
    preliminary = top_k(similar, word_eligible(insertion), candidates)
    return first_that_can(
        insertion,
        (NONE, words & triples, top_k(related, preliminary, k)),
        (RS, triples, top_k(related, insertion.eligible[:, None], k)),
        (ES, words, top_k(similar, word_eligible(insertion), k)),
    )
