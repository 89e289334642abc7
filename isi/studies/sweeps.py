"""What is varied around the main experiment: the size of the indicator set (section 5.3), the fine-tuning rate."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from isi.base.params import Count, Name, Option, Positive, Study, check, distinct
from isi.base.stage import Given


class SweepOf(Study):
    """``sweep`` in params, less its initializers."""

    k: Annotated[list[Count], Field(min_length=1)]
    size: Count
    seeds: Count

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if sorted(set(self.k)) != self.k:
            raise ValueError("k must ascend, without repeats")
        return self


class Sweep(SweepOf):
    """``sweep`` in params."""

    #: options beside k, by initializer
    initializers: Annotated[dict[Name, dict[str, Option]], Field(min_length=1)]

    @classmethod
    def of(cls, given: Given, initializer: str) -> Sweep:
        """The sweep of one initializer: all that its stage is given."""
        values = {name: given.raw(f"sweep.{name}") for name in SweepOf.model_fields}
        own = given.raw(f"sweep.initializers.{initializer}")
        return check(values | {"initializers": {initializer: own}}, cls, "sweep")


class Rates(Study):
    """``rates`` in params."""

    factors: Annotated[list[Positive], Field(min_length=1)]
    size: Count

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        if 1 in self.factors or not distinct(self.factors):
            raise ValueError("factors must not repeat, nor be 1, which is the main experiment")
        return self
