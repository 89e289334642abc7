"""Scores of all answers to a query with NumPy alone, since the import of PyTorch, with which
``isi.models`` computes the same, takes a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from isi.config import Positive, Section
from isi.errors import InputError

if TYPE_CHECKING:
    from isi.models.stack import Embedding

#: Percentage of the coordinates that are scalars, the others being blocks of two, of the models
#: whose relations are maps (``isi.models.bilinear``); and models whose relations are translations.
SCALARS = {"analogy": 50, "complex": 0, "distmult": 100, "rotate": 0}
TRANSLATIONS = ("transe", "transe_l1")
DISTANCES = (*TRANSLATIONS, "rotate")
#: Multiple of which the dimension is, where it is not any.
MULTIPLES = {"analogy": 4, "complex": 2, "rotate": 2}
NEAREST = 1e-6  #: Smallest squared distance, as in ``isi.models.scoring``.


class ModelOptions(Section):
    """The options of a model, as ``isi.models`` has them."""

    constraint: Literal["none", "sphere", "ball"] = "none"
    margin: Positive | None = None  #: of a distance
    squared: bool = False


@dataclass(frozen=True, eq=False)
class ArrayScores:
    """Scores by one of the models of ``SCALARS`` and ``TRANSLATIONS``.

    Example:
        >>> import numpy as np
        >>> entities, relations = np.array([[1.0, 2.0], [0.0, 3.0]]), np.array([[1.0, -1.0]])
        >>> scores = ArrayScores("distmult", ModelOptions(), entities, relations)
        >>> scores.tails(np.array([0]), 0).tolist()
        [[-3.0, -6.0]]
    """

    model: str
    options: ModelOptions
    entity: np.ndarray  #: float32, shape (E, d)
    relation: np.ndarray  #: float32, shape (R, w)

    def __post_init__(self) -> None:
        """``InputError`` for a relation's row or a dimension that is none of the model."""
        dimension = self.entity.shape[1]
        width = dimension // 2 if self.model == "rotate" else dimension
        multiple = MULTIPLES.get(self.model, 1)
        if dimension % multiple or self.relation.shape[1] != width:
            expected = f"expected vectors of {self.model}: of entities a multiple of {multiple}"
            shapes = f"{self.entity.shape} and {self.relation.shape}"
            raise InputError("vectors", "", f"{expected}, of relations {width} wide, got {shapes}")
        if (self.options.margin is None) == (self.model in DISTANCES):
            raise InputError("model_options", "margin", f"expected one of a distance: {self.model}")

    def tails(self, heads: np.ndarray, relation: int) -> np.ndarray:
        """Of all entities as tails of heads, ids (Q,), and a relation; shape (Q, E), float32."""
        mapped = self._mapped(self.entity[heads], self.relation[relation], 1)
        return self._compared(mapped, self.entity, self._squares)

    def heads(self, tails: np.ndarray, relation: int) -> np.ndarray:
        """Of all entities as heads; shape (Q, E), float32."""
        mapped = self._mapped(self.entity[tails], self.relation[relation], -1)
        return self._compared(mapped, self.entity, self._squares)

    def relations(self, head: int, tail: int) -> np.ndarray:
        """Of all relations between two entities; shape (R,), float32."""
        mapped, end = self._mapped(self.entity[head], self.relation, 1), self.entity[[tail]]
        scores: np.ndarray = self._compared(mapped, end, _squares(end))[:, 0]
        return np.asarray(scores)

    def _mapped(self, vectors: np.ndarray, rows: np.ndarray, sign: int) -> np.ndarray:
        """Heads mapped by relations (sign 1), or tails mapped back (-1): shapes (..., d), (..., w),
        which broadcast, result (..., d).
        """
        if self.model in TRANSLATIONS:
            return np.asarray(vectors + sign * rows)
        if self.model == "rotate":
            rows = np.concatenate([np.cos(rows), np.sin(rows)], -1)
        scalars, x, y = self._parts(rows)
        v, a, b = self._parts(vectors)
        y = sign * y
        return np.concatenate([v * scalars, a * x - b * y, b * x + a * y], -1)

    def _parts(self, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Vectors as scalars, and first and second coordinates of blocks; (..., d)."""
        dimension = vectors.shape[-1]
        first = dimension * SCALARS[self.model] // 100
        middle = (first + dimension) // 2
        return vectors[..., :first], vectors[..., first:middle], vectors[..., middle:]

    def _compared(self, mapped: np.ndarray, ends: np.ndarray, squares: np.ndarray) -> np.ndarray:
        """Scores of mapped vectors, (Q, d), and other ends, (E, d), whose ``_squares`` are (E,);
        shape (Q, E).
        """
        if self.options.margin is None:
            return np.asarray(mapped @ ends.T)
        if self.model == "transe_l1":
            distances = np.stack([np.abs(ends - vector).sum(1) for vector in mapped])
        else:
            gaps = _squares(mapped)[:, None] + squares - 2 * (mapped @ ends.T)
            distances = np.maximum(gaps, NEAREST)
            if not self.options.squared:
                distances = np.sqrt(distances)
        return np.asarray(np.float32(self.options.margin) - distances)

    @cached_property
    def _squares(self) -> np.ndarray:
        return _squares(self.entity)


@dataclass(frozen=True, eq=False)
class ModelScores:
    """As ``ArrayScores``, by any ``isi.models.model.Model``, with PyTorch."""

    embedding: Embedding  #: of one model

    def tails(self, heads: np.ndarray, relation: int) -> np.ndarray:
        return self._scores("score_tails", heads, np.full_like(heads, relation))

    def heads(self, tails: np.ndarray, relation: int) -> np.ndarray:
        return self._scores("score_heads", np.full_like(tails, relation), tails)

    def relations(self, head: int, tail: int) -> np.ndarray:
        scores: np.ndarray = self._scores("score_relations", np.array([head]), np.array([tail]))[0]
        return scores

    def _scores(self, method: str, *ids: np.ndarray) -> np.ndarray:
        import torch

        from isi.models.stack import usual_torch

        with usual_torch():
            tensors = [torch.from_numpy(column)[None] for column in ids]
            scores = getattr(self.embedding, method)(*tensors)[0].detach()
        return np.asarray(scores)


Scores = ArrayScores | ModelScores


def _squares(vectors: np.ndarray) -> np.ndarray:
    """The squared lengths of vectors, (N, d); shape (N,)."""
    return np.asarray(np.square(vectors).sum(1))
