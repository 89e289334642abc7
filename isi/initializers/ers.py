"""ERS, hybrid of ES and RS: of what goes by a similar name, what stands in the same relations."""

from __future__ import annotations

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.similarity import nearest_by_both


@initializer("ers", label="ERS", role="isi", colour="#d55e00")
def hybrid_similarity(insertion: Insertion, k: Count, candidates: Count) -> Initial:
    """RS among the best of ES, as many as ``candidates`` (equation 6)."""
    return nearest_by_both(insertion, k, candidates)
