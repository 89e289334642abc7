"""ComplEx (Trouillon et al. 2016): complex vectors, real halves before imaginary ones."""

from __future__ import annotations

from dataclasses import dataclass

from isi.embeddings.blocks import Blocks
from isi.families import family


@family("complex")
@dataclass(frozen=True)
class ComplEx(Blocks):
    """f(h, r, t) = Re⟨vₕ ⊙ r, conj(vₜ)⟩: all coordinates are of blocks."""

    scalars = 0
