"""Mean: the centre of what is known, without a choice of indicators (a control)."""

from __future__ import annotations

import torch

from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import at_centroid, everyone_known


@initializer("mean", label="Mean", role="control", colour="#a08a5b")
def mean(insertion: Insertion) -> Initial:
    """Centroid of all known entities (equation 1)."""
    return at_centroid(insertion, everyone_known(insertion), torch.full(insertion.novel.shape, NONE))
