"""Initializers by name, and how the report shows each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from isi.base.params import keywords
from isi.base.plugins import Plugins
from isi.insertion.core import Initializer

#: The paper's baselines, ISI, controls (each has a part of what ISI has beside meaning), strong baselines that the
#: paper does not have, and anyone's own.
Role = Literal["paper", "isi", "control", "baseline", "own"]


@dataclass(frozen=True)
class Registered:
    """An initializer, and how the report shows it."""

    function: Initializer
    #: what people read
    label: str
    role: Role
    #: of its curves, ``#rrggbb``; where there is none, the report takes a spare one
    colour: str | None


INITIALIZERS: Plugins[Registered] = Plugins("isi.initializers")


def initializer(
    name: str, label: str | None = None, role: Role = "own", colour: str | None = None
) -> Callable[[Initializer], Initializer]:
    """Register an initializer; its parameters after the insertion are its options, and their types what they may be."""

    def register(function: Initializer) -> Initializer:
        INITIALIZERS.register(name, Registered(function, label or name, role, colour))
        return function

    return register


def options_of(name: str, given: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The options of an initializer, as keyword arguments of its function.

    Raises:
        InputError: where no initializer has the name, or it does not take these options; ``key`` is where
            they stand in params.
    """
    return keywords(INITIALIZERS.get(name, key).function, given, key)
