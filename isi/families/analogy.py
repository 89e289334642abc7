"""ANALOGY (Liu et al. 2017): normal, commuting linear maps as relations (section 2)."""

from __future__ import annotations

from dataclasses import dataclass

from isi.embeddings.blocks import Blocks
from isi.families import family


@family("analogy")
@dataclass(frozen=True)
class ANALOGY(Blocks):
    """f(h, r, t) = ⟨vₕᵀW, vₜ⟩: half of the coordinates are scalars, half are of blocks."""

    scalars = 50
