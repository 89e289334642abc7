"""How what is compared is called and drawn: initializers, as they registered themselves, and the joint model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from isi.initializers.api import INITIALIZERS, Registered, Role

JOINT = "joint"
#: Θ⁰ trained on with nothing inserted.
NOTHING = "nothing"
#: What is no initializer: how it is called, its colour and its line.
_OTHERS = {JOINT: ("Joint", "#000000", "--"), NOTHING: ("Nothing inserted", "#8c2d04", ":")}
#: Gains are over the paper's own baseline.
BASELINE = "xavier"
#: Of initializers that bring no colour of their own.
_SPARE = ("#cc79a7", "#56b4e9", "#f0e442", "#8c564b")


def registered(initializer: str) -> Registered:
    """What an initializer says of itself.

    Raises:
        InputError: where no module of that name registers it.
    """
    return INITIALIZERS.get(initializer, f"initializers.{initializer}")


def label(model: str) -> str:
    """How a model is called where people read."""
    return _OTHERS[model][0] if model in _OTHERS else registered(model).label


def of_role(models: Iterable[str], *roles: Role) -> list[str]:
    """Those of the initializers that have one of the roles, in their order."""
    return [name for name in models if name not in _OTHERS and registered(name).role in roles]


def isi(models: Iterable[str]) -> list[str]:
    """The initializers that the paper proposes."""
    return of_role(models, "isi")


def controls(models: Iterable[str]) -> list[str]:
    """Those that have a part of what ISI has beside meaning."""
    return of_role(models, "control")


def contenders(models: Iterable[str]) -> list[str]:
    """Those under test: all initializers but controls."""
    return of_role(models, "paper", "isi", "baseline", "own")


def is_control(model: str) -> bool:
    return bool(controls([model]))


def colour(model: str, models: Sequence[str]) -> str:
    """The colour of a model in every figure; ``models``: all, which share out the spare ones."""
    if model in _OTHERS:
        return _OTHERS[model][1]
    own = [name for name in models if name not in _OTHERS and registered(name).colour is None]
    return registered(model).colour or _SPARE[own.index(model) % len(_SPARE)]


def dashes(model: str) -> Any:
    """Solid for what is under test; all else is dashed or dotted."""
    return _OTHERS[model][2] if model in _OTHERS else (0, (3, 1.5)) if is_control(model) else "-"


def described(initializer: str) -> str:
    """What an initializer is, as it says itself; its label alone where it does not."""
    return registered(initializer).description or f"{label(initializer)}."
