"""DistMult (Yang et al. 2015): one factor a coordinate; a triple and its reverse score alike."""

from __future__ import annotations

from dataclasses import dataclass

from isi.embeddings.blocks import Blocks
from isi.families import family


@family("distmult")
@dataclass(frozen=True)
class DistMult(Blocks):
    """f(h, r, t) = ⟨vₕ ⊙ r, vₜ⟩."""

    scalars = 100
