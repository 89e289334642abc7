"""PyKEEN's representations as rows of real numbers, and back: complex ones are real halves, then imaginary ones."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import torch
from pykeen.nn.representation import Representation
from torch import Tensor


@dataclass(frozen=True)
class Form:
    """How a row of real numbers lies in a representation."""

    shape: tuple[int, ...]
    is_complex: bool

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return prod(self.shape) * (1 + self.is_complex)

    def rows(self, values: Tensor) -> Tensor:
        """Values of shape (N, *shape) as rows, (N, size)."""
        flat = values.flatten(1)
        return torch.cat([flat.real, flat.imag], 1) if self.is_complex else flat

    def values(self, rows: Tensor) -> Tensor:
        """Rows of shape (..., size) as values, (..., *shape)."""
        if self.is_complex:
            rows = torch.complex(*(half.contiguous() for half in rows.chunk(2, -1)))
        return rows.reshape(*rows.shape[:-1], *self.shape)


def read(representation: Representation) -> tuple[Form, Tensor]:
    """The form of a representation, and all its rows; without dropout, after its normalizer."""
    training = representation.training
    with torch.no_grad():
        values = representation.eval()().detach().cpu()
    representation.train(training)
    form = Form(tuple(representation.shape), values.is_complex())
    return form, form.rows(values)
