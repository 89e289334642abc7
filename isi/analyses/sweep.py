"""What is varied around the main experiment: the size of the indicator set (section 5.3), the fine-tuning rate."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from isi.config import Count, Name, Option, Positive, Study, distinct
from isi.experiment.tables import runs_table
from isi.tables.rules import at_least
from isi.tables.table import INT, REAL

#: Runs with ``k`` indicators, and at ``factor`` times the fine-tuning rate.
INDICATOR_SWEEP = runs_table(
    "data/analyses/indicator_sweep/{experiment}/{initializer}.parquet", {"k": INT}, at_least(1, "k")
)
RATE_SWEEP = runs_table(
    "data/analyses/rate_sweep/{experiment}/{initializer}.parquet", {"factor": REAL}, at_least(0, "factor")
)


class Sweep(Study):
    """``sweep`` in params: which sizes of indicator sets are tried, by which initializers, on which grid points."""

    #: options beside k, by initializer
    initializers: Annotated[dict[Name, dict[str, Option]], Field(min_length=1)]
    k: Annotated[list[Count], Field(min_length=1)]
    size: Count
    seeds: Count

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if sorted(set(self.k)) != self.k:
            raise ValueError("k must ascend, without repeats")
        return self


class RateSweep(Study):
    """``rate_sweep`` in params: multiples of the fine-tuning rate, and the size at which they are tried."""

    initializers: list[Name]
    factors: Annotated[list[Positive], Field(min_length=1)]
    size: Count

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        if 1 in self.factors or not distinct(self.factors):
            raise ValueError("factors must not repeat, nor be 1, which is the main experiment")
        return self
