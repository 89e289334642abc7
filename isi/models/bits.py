"""The same bits for a model wherever it stands in a stack, and for a query whatever stands beside it.

PyTorch takes the numbers of an array a register at a time. It rounds the last few, which fill no register,
otherwise than the rest (by another σ, or without fusing a product with its sum). So what a model learns would
depend on its place in the stack. Two means keep results equal to the byte for any height of the stack:

- a table with a spare row behind each model (``empty``, ``spaced``) is not contiguous, so that PyTorch runs over
  it model by model;
- a list is padded to whole registers (``padded``), so that none of its numbers is among the last few.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor
from torch.nn.functional import pad

#: A multiple of the numbers that PyTorch takes at once, on any processor.
_REGISTER = 64


def empty(like: Tensor, models: int, rows: int, width: int) -> Tensor:
    """Zeros of shape (M, rows + 1, width): tables with a spare row behind each model."""
    return like.new_zeros(models, rows + 1, width)


def spaced(table: Tensor) -> Tensor:
    """A copy of a stack of tables with a spare row in memory between models; shape (M, N, d)."""
    return empty(table, *table.shape)[:, :-1].copy_(table)


def padded(function: Callable[[Tensor], Tensor], values: Tensor) -> Tensor:
    """An elementwise function, with the same bits wherever a number stands; any shape."""
    flat = values.flatten()
    return function(pad(flat, (0, -len(flat) % _REGISTER)))[: len(flat)].view(values.shape)
