"""ES permuted within kinds: centroids of entities of the right kind, chosen without meaning (a control)."""

from __future__ import annotations

from isi.base.params import Count
from isi.initializers import initializer
from isi.insertion.core import Initial, Insertion
from isi.insertion.dealing import dealt_word_similarity, dealt_words
from isi.insertion.similarity import nearest_by_words


@initializer("es_permuted_kinds", label="ES permuted within kinds", role="control", colour="#5f7f96")
def permuted_within_kinds(insertion: Insertion, k: Count) -> Initial:
    """ES with the word vectors dealt out anew among the entities of a kind that have one."""
    dealt = dealt_words(insertion, "es_permuted_kinds", insertion.kinds)
    return nearest_by_words(insertion, dealt_word_similarity(insertion, dealt), k)
