"""Kind mean: the centre of what is known of the same kind, what kind alone is worth (a control)."""

from __future__ import annotations

import torch

from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import first_that_can, same_kind


@initializer("kind_mean", label="Kind mean", role="control", colour="#6f8f5b")
def kind_mean(insertion: Insertion) -> Initial:
    """Centroid of the known entities of the novel one's kind; of all known where there is none."""
    return first_that_can(insertion, (NONE, torch.ones_like(insertion.novel, dtype=torch.bool), same_kind(insertion)))
