"""The same bits for a model wherever it stands in a stack, and for a query whatever stands beside it.

PyTorch takes the numbers of an array a register at a time and rounds the last few, which fill none,
otherwise than the rest (by another σ, or without fusing a product with its sum). A solid stack of
tables is one array to it, so that what a model learns would depend on how many stand before it. It
is three tricks that keep results equal to the byte for any height of the stack:

- a table with a row left out behind each model (``room``, ``apart``) is no solid array. PyTorch then
  runs over it model by model;
- a list is padded to whole registers (``padded``), so that no number of it is among the last few;
- sums over queries are taken one after the other (``ordered_sum``), so that padding, which adds
  zeros, changes nothing. Sums by blocks would be split elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor
from torch.nn.functional import pad

#: A multiple of the numbers that PyTorch takes at once, on any processor.
_REGISTER = 64


def room(like: Tensor, models: int, rows: int, width: int) -> Tensor:
    """Zeros of shape (M, rows + 1, width): place for tables, and the row that keeps models apart."""
    return like.new_zeros(models, rows + 1, width)


def apart(table: Tensor) -> Tensor:
    """A copy of a stack of tables in which models lie apart; shape (M, N, d)."""
    models, rows, width = table.shape
    copy = room(table, models, rows, width)[:, :-1]
    return copy.copy_(table)


def padded(function: Callable[[Tensor], Tensor], values: Tensor) -> Tensor:
    """A function of single numbers, to the same bits wherever a number stands; any shape."""
    flat = values.flatten()
    return function(pad(flat, (0, -len(flat) % _REGISTER)))[: len(flat)].view(values.shape)


def ordered_sum(terms: Tensor) -> Tensor:
    """Sum over the second dimension, one after the other; shape (M, Q), result (M,), float64."""
    return terms.double().cumsum(1)[:, -1]
