"""The one map of vectors: the distance from a centre, and the place along an axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Projection:
    """Two coordinates of vectors, of which the first leaves nothing out:
    what is far from the centre is drawn far from it.
    """

    centre: np.ndarray  #: mean of the vectors; shape: (d,)
    axis: np.ndarray  #: their first principal axis, of length 1; shape: (d,)
    share: float  #: share of their variance along the axis

    @classmethod
    def of(cls, vectors: np.ndarray) -> Projection:
        """The projection of known vectors, (N, d).

        The largest coordinate of the axis, in size, is positive.
        """
        centre = vectors.mean(0, dtype=np.float64)
        _, strength, axes = np.linalg.svd(vectors - centre, full_matrices=False)
        axis = axes[0] * np.sign(axes[0, np.abs(axes[0]).argmax()])
        return cls(centre, axis, float(strength[0] ** 2 / (strength**2).sum()))

    def places(self, vectors: np.ndarray) -> np.ndarray:
        """Distance from the centre in all d dimensions, and place along the axis;
        (N, d) to (N, 2).
        """
        offsets = vectors - self.centre
        return np.stack([np.linalg.norm(offsets, axis=-1), offsets @ self.axis], -1)


def ticks(low: float, high: float) -> list[float]:
    """Round numbers between two, about four to eight."""
    widest = (high - low) / 3
    power = 10.0 ** np.floor(np.log10(widest))
    step = power * max(factor for factor in (1, 2, 5) if factor * power <= widest)
    return [float(np.round(step * n, 9)) for n in np.arange(np.ceil(low / step), high / step)]
