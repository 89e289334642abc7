"""Numbers in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import nan

from isi.report.models import label


def joined(parts: Iterable[str]) -> str:
    """One, two and three; "none" where there is nothing."""
    *first, last = list(parts) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def listed(values: Mapping[str, float], models: Sequence[str], form: str = "{:.1f}") -> str:
    """Each model with its value, of those that have one."""
    return joined(f"{label(model)} {form.format(values[model])}" for model in models if model in values)


def reached(epochs: Mapping[str, float], never: Mapping[str, float], models: Sequence[str]) -> str:
    """Each model with its epochs to convergence, and the share of its runs that never converge (per cent)."""

    def never_there(model: str) -> str:
        return f" ({never[model]:.0f} % of runs never get there)" if never.get(model) else ""

    return joined(f"{label(model)} {epochs[model]:.1f}{never_there(model)}" for model in models if model in epochs)


def mean(values: Mapping[str, float], models: Iterable[str]) -> float:
    """Over those of the models that have a value; null without any."""
    own = [values[model] for model in models if model in values]
    return sum(own) / len(own) if own else nan


def capitalized(text: str) -> str:
    """The same with a capital first letter."""
    return text[:1].upper() + text[1:]
