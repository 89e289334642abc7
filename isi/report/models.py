"""Labels, roles and colours of what the report compares: the registered initializers, and models that are none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from isi.initializers.api import INITIALIZERS, Registered, Role

JOINT = "joint"
#: Θ⁰ trained on without any insertion.
FINETUNE_ONLY = "finetune_only"
#: Label, colour and line of models that are no initializers.
_OTHERS = {JOINT: ("Joint", "#000000", "--"), FINETUNE_ONLY: ("Nothing inserted", "#8c2d04", ":")}
#: Gains are over the paper's own baseline.
BASELINE = "xavier"
#: Of initializers that register no colour.
_SPARE = ("#cc79a7", "#56b4e9", "#f0e442", "#8c564b")


def registered(initializer: str) -> Registered:
    """The registration of an initializer.

    Raises:
        InputError: where no module registers the name.
    """
    return INITIALIZERS.get(initializer, f"initializers.{initializer}")


def label(model: str) -> str:
    """The name of a model where people read."""
    return _OTHERS[model][0] if model in _OTHERS else registered(model).label


def of_role(models: Iterable[str], *roles: Role) -> list[str]:
    """Those of the initializers that have one of the roles, in their order."""
    return [name for name in models if name not in _OTHERS and registered(name).role in roles]


def isi(models: Iterable[str]) -> list[str]:
    """The initializers that the paper proposes."""
    return of_role(models, "isi")


def controls(models: Iterable[str]) -> list[str]:
    """Initializers that have a part of what ISI has beside meaning."""
    return of_role(models, "control")


def contenders(models: Iterable[str]) -> list[str]:
    """Those under test: all initializers but controls."""
    return of_role(models, "paper", "isi", "baseline", "own")


def is_control(model: str) -> bool:
    return bool(controls([model]))


def line_style(model: str, models: Sequence[str]) -> dict[str, Any]:
    """Colour, label and dashes of a model's line; ``models``: all in the report, which share out the spare colours."""
    if model in _OTHERS:
        return dict(zip(("label", "color", "ls"), _OTHERS[model], strict=True))
    uncoloured = [name for name in models if name not in _OTHERS and registered(name).colour is None]
    colour = registered(model).colour or _SPARE[uncoloured.index(model) % len(_SPARE)]
    return {"label": label(model), "color": colour, "ls": (0, (3, 1.5)) if is_control(model) else "-"}


def colour(model: str, models: Sequence[str]) -> str:
    """The colour of a model in every figure."""
    return str(line_style(model, models)["color"])


def described(initializer: str) -> str:
    """What an initializer is, as it says itself; its label alone where it does not."""
    return registered(initializer).description or f"{label(initializer)}."
