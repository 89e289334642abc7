"""What the page calls scopes and columns, and lists of models with their numbers for its sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import nan

from isi.report.models import label
from isi.report.tables import Estimate

#: The queries of each scope.
SCOPES = {
    "all": "all queries",
    "novel": "novel entities",
    "novel_heldout": "novel entities, held-out triples",
    "known": "earlier knowledge",
    "known_closed": "earlier knowledge, known candidates only",
}
#: Headers of files that the page spells out.
WORDS = SCOPES | {
    "entity half": "entity prediction",
    "relation half": "relation prediction",
    "std": "deviation",
    "scope": "queries",
    "scope's filter": "usual filter",
    "all true": "all true triples left out",
    "unconverged %": "never converged, %",
    "p (Holm)": "p, corrected",
    "of these differ": "seeds that differ",
    "share %": "share, %",
    "gain %": "gain, %",
    "drop %": "drop, %",
    "epochs, all": "epochs: all queries",
    "epochs, novel_heldout": "epochs: novel entities, held-out triples",
}


def joined(parts: Iterable[str]) -> str:
    """One, two and three; "none" where there is nothing."""
    *first, last = list(parts) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def with_values(
    values: Mapping[str, float | Estimate], models: Iterable[str] | None = None, form: str = "{:.1f}"
) -> str:
    """Each model with its value, of those that have one."""
    names = values if models is None else [model for model in models if model in values]
    return joined(f"{label(model)} {form.format(values[model])}" for model in names)


def listed_epochs(epochs: Mapping[str, float], unconverged: Mapping[str, float], models: Sequence[str]) -> str:
    """Each model with its epochs to convergence, and the share of its runs that never converge (per cent)."""

    def never(model: str) -> str:
        return f" ({unconverged[model]:.0f} % of runs never converge)" if unconverged.get(model) else ""

    return joined(f"{label(model)} {epochs[model]:.1f}{never(model)}" for model in models if model in epochs)


def mean_of(values: Mapping[str, float], models: Iterable[str]) -> float:
    """The mean over those of the models that have a value; null without any."""
    numbers = [values[model] for model in models if model in values]
    return sum(numbers) / len(numbers) if numbers else nan


def capitalized(text: str) -> str:
    """The same with a capital first letter."""
    return text[:1].upper() + text[1:]
