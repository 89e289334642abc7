"""A model that diverges or collapses is stopped before anything is measured of it, and said to be one."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from isi.base.errors import InputError

#: Of coordinates: above it, a product of three of them, summed over a vector, may be no float32.
LARGEST = 1e11


class NotFinite(InputError):
    """NaN or infinity in what some models of a stack hold, would answer, or are to be inserted into by."""

    def __init__(self, models: list[int], found: str) -> None:
        super().__init__("", "", found)
        #: their places in the stack
        self.models = models
        #: in what, and what to do
        self.found = found

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.models, self.found)


def refuse(tables: tuple[Tensor, ...], what: str, largest: float = LARGEST) -> None:
    """Refuse values that are no numbers, or so large that scores are none; shapes (M, ...).

    Raises:
        NotFinite: naming the models that have such.
    """
    sound = torch.stack([table.flatten(1).abs().amax(1) <= largest for table in tables]).all(0)  # NaN is not
    if not sound.all():
        raise NotFinite((~sound).nonzero()[:, 0].tolist(), f"NaN or infinity in {what}")
