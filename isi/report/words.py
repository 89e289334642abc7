"""Words of the report: labels, roles and colours of models, names of scopes, and lists within sentences."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from isi.initializers.api import INITIALIZERS, Registered, Role
from isi.report.tables import Column

JOINT = "joint"
#: Θ⁰ trained on without any insertion.
FINETUNE_ONLY = "finetune_only"
#: Label, colour and line of models that are no initializers.
_OTHERS = {JOINT: ("Joint", "#000000", "--"), FINETUNE_ONLY: ("Nothing inserted", "#8c2d04", ":")}
#: Gains are over the paper's own baseline.
BASELINE = "xavier"
#: Of initializers that register no colour.
_SPARE = ("#cc79a7", "#56b4e9", "#f0e442", "#8c564b")
#: The queries of each scope.
SCOPES = {
    "all": "all queries", "novel": "novel entities", "novel_heldout": "novel entities, held-out triples",
    "known": "earlier knowledge", "known_closed": "earlier knowledge, known candidates only",
}  # fmt: skip
#: MRR* and its halves, and headers of files; where the page has other words, ``WORDS`` has them.
HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity half", "mrr_star_relation": "relation half"}
SCOPE = Column("scope", words=SCOPES)
#: Headers of files that the page spells out.
WORDS = SCOPES | {
    "entity half": "entity prediction", "relation half": "relation prediction", "std": "deviation", "scope": "queries",
    "scope's filter": "usual filter", "all true": "all true triples left out", "unconverged %": "never converged, %",
    "p (Holm)": "p, corrected", "of these differ": "seeds that differ", "share %": "share, %", "gain %": "gain, %",
    "drop %": "drop, %", "epochs, all": "epochs: all queries",
    "epochs, novel_heldout": "epochs: novel entities, held-out triples",
}  # fmt: skip


def _registered(initializer: str) -> Registered:
    return INITIALIZERS.get(initializer, f"initializers.{initializer}")


def label(model: str) -> str:
    """The name of a model where people read; ``InputError`` where no module registers it."""
    return _OTHERS[model][0] if model in _OTHERS else _registered(model).label


def described(initializer: str) -> str:
    """What an initializer is, as it says itself; its label alone where it does not."""
    return _registered(initializer).description or f"{label(initializer)}."


def of_role(models: Iterable[str], *roles: Role) -> list[str]:
    """Those of the initializers that have one of the roles, in their order."""
    return [name for name in models if name not in _OTHERS and _registered(name).role in roles]


def isi(models: Iterable[str]) -> list[str]:
    """The initializers that the paper proposes."""
    return of_role(models, "isi")


def controls(models: Iterable[str]) -> list[str]:
    """The controls: initializers that have what ISI has apart from meaning, or a part of it."""
    return of_role(models, "control")


def contenders(models: Iterable[str]) -> list[str]:
    """Those under test: all initializers but controls."""
    return of_role(models, "paper", "isi", "baseline", "own")


def line_style(model: str, models: Sequence[str]) -> dict[str, Any]:
    """Colour, label and dashes of a model's line; ``models``: all in the report, which share out the spare colours."""
    if model in _OTHERS:
        return dict(zip(("label", "color", "ls"), _OTHERS[model], strict=True))
    uncoloured = [name for name in models if name not in _OTHERS and _registered(name).colour is None]
    colour = _registered(model).colour or _SPARE[uncoloured.index(model) % len(_SPARE)]
    return {"label": label(model), "color": colour, "ls": (0, (3, 1.5)) if controls([model]) else "-"}


def colour(model: str, models: Sequence[str]) -> str:
    """The colour of a model in every figure."""
    return str(line_style(model, models)["color"])


def joined(parts: Iterable[str]) -> str:
    """One, two and three; "none" where there is nothing."""
    *first, last = list(parts) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def with_values(values: Mapping[str, float], models: Iterable[str] | None = None, form: str = "{:.1f}") -> str:
    """Each model with its value, of those that have one."""
    names = values if models is None else [model for model in models if model in values]
    return joined(f"{label(model)} {form.format(values[model])}" for model in names)


def listed_epochs(epochs: Mapping[str, float], unconverged: Mapping[str, float], models: Sequence[str]) -> str:
    """Each model with its epochs to convergence, and the share of its runs that never converge (per cent)."""
    never = {model: f" ({share:.0f} % of runs never converge)" for model, share in unconverged.items() if share}
    return joined(f"{label(model)} {epochs[model]:.1f}{never.get(model, '')}" for model in models if model in epochs)


def capitalized(text: str) -> str:
    """The same with a capital first letter."""
    return text[:1].upper() + text[1:]


def in_order(values: Iterable[str], first: Sequence[str]) -> list[str]:
    """Values in a given order, the others behind it as they come."""
    present = list(values)
    return [value for value in first if value in present] + [value for value in present if value not in first]
