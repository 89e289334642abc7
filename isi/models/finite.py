"""Whether numbers of a stack are finite: a model that diverges is stopped before anything is measured of it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from isi.errors import InputError

#: Largest sound coordinate: above it, a product of three of them, summed over a vector, may overflow float32.
LARGEST = 1e11


class NotFinite(InputError):
    """NaN or infinity in some models of a stack."""

    def __init__(self, models: list[int], problem: str) -> None:
        super().__init__("", "", problem)
        #: their places in the stack
        self.models = models
        #: where the numbers are not finite, and what to do
        self.problem = problem

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.models, self.problem)


def check_finite(tables: tuple[Tensor, ...], name: str, largest: float = LARGEST) -> None:
    """Check that |x| ≤ ``largest`` for every number of tables; shapes (M, ...).

    Raises:
        NotFinite: naming the models with a larger number, an infinity or NaN.
    """
    sound = torch.stack([table.flatten(1).abs().amax(1) <= largest for table in tables]).all(0)  # NaN is not
    if not sound.all():
        raise NotFinite((~sound).nonzero()[:, 0].tolist(), f"NaN or infinity in {name}")
