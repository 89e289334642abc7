"""Words of the report: labels, roles and colours of models, names of scopes,
and lists within sentences.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from isi import config
from isi.initializers.api import INITIALIZERS, Registered, Role
from isi.report.tables import Column

Names = Sequence[str]  #: Of models, scopes or columns, in order.
JOINT = "joint"
#: The model without insertion: Θ⁰, fine-tuned.
FINETUNE_ONLY = "finetune_only"
#: Label, colour and line style of models that are not initializers.
_OTHERS = {JOINT: ("Joint", "#000000", "--"), FINETUNE_ONLY: ("Nothing inserted", "#8c2d04", ":")}
#: The paper's baseline, the reference of all gains.
BASELINE = "xavier"
#: Colours of initializers that register none.
_SPARE = ("#cc79a7", "#56b4e9", "#f0e442", "#8c564b")
TEMPLATES = Path(__file__).parent / "templates"
_LISTS: dict[str, dict[str, str]] = config.read(TEMPLATES / "words.yaml")
#: Title of each scope on the page.
SCOPES = _LISTS["scopes"]
#: MRR* and its halves, with their headers in files; ``WORDS`` has those of the page, if they
#: differ.
HALVES = {
    "mrr_star": "MRR*",
    "mrr_star_entity": "entity half",
    "mrr_star_relation": "relation half",
}
#: Questions about an entity, by relation of which it is the head.
QUESTIONS = _LISTS["questions"]
SCOPE = Column("scope", words=SCOPES)
#: Headers on the page, by header in files.
WORDS = SCOPES | _LISTS["headers"]


def _registered(initializer: str) -> Registered:
    return INITIALIZERS.get(initializer, f"initializers.{initializer}")


def label(model: str) -> str:
    """The display name of a model; ``InputError`` if no module registers it."""
    return _OTHERS[model][0] if model in _OTHERS else _registered(model).label


def labelled(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by model as values by label."""
    return {label(model): value for model, value in values.items()}


def described(initializer: str) -> str:
    """The registered description of an initializer; its label if there is none."""
    return _registered(initializer).description or f"{label(initializer)}."


def of_role(models: Iterable[str], *roles: Role) -> list[str]:
    """The initializers among ``models`` with one of the roles, in order."""
    return [name for name in models if name not in _OTHERS and _registered(name).role in roles]


def isi(models: Iterable[str]) -> list[str]:
    """The initializers that the paper proposes."""
    return of_role(models, "isi")


def controls(models: Iterable[str]) -> list[str]:
    """The controls: initializers that share a property with ISI but use no
    meaning of words or relations.
    """
    return of_role(models, "control")


def contenders(models: Iterable[str]) -> list[str]:
    """The initializers under test: all but controls."""
    return of_role(models, "paper", "isi", "baseline", "own")


def line_style(model: str, models: Names) -> dict[str, Any]:
    """Matplotlib's colour, label and dashes of a model;
    ``models``: all in the figures (for spare colours).
    """
    if model in _OTHERS:
        return dict(zip(("label", "color", "ls"), _OTHERS[model], strict=True))
    uncoloured = [
        name for name in models if name not in _OTHERS and _registered(name).colour is None
    ]
    colour = _registered(model).colour or _SPARE[uncoloured.index(model) % len(_SPARE)]
    return {
        "label": label(model),
        "color": colour,
        "ls": (0, (3, 1.5)) if controls([model]) else "-",
    }


def colour(model: str, models: Names) -> str:
    """The colour of a model in every figure."""
    return str(line_style(model, models)["color"])


def question(relation: str) -> str:
    """The question of which a new entity and a relation are given, in words."""
    return QUESTIONS.get(relation, f"(it, {relation}, ?)")


def joined(parts: Iterable[str]) -> str:
    """The parts as an enumeration, "a, b and c"; "none" without parts."""
    *first, last = list(parts) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def with_values(
    values: Mapping[str, float], models: Iterable[str] | None = None, form: str = "{:.1f}"
) -> str:
    """An enumeration of the models that have a value, each with its value."""
    names = values if models is None else [model for model in models if model in values]
    return joined(f"{label(model)} {form.format(values[model])}" for model in names)


def capitalized(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def in_order(values: Iterable[str], first: Names) -> list[str]:
    """Values in the order of ``first``, then the others in their own order."""
    present = list(values)
    return [value for value in first if value in present] + [
        value for value in present if value not in first
    ]
