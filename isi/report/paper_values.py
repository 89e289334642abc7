"""The paper's numbers and words, from the files of ``data/raw/paper``: any part may be missing."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

from isi import config
from isi.errors import InputError
from isi.report.models import registered

#: Shapes of leaves, each with what stands for one that a file leaves out.
NUMBER, TEXT, TEXTS = "a number", "text", "a list of text"
_MISSING: dict[str, Any] = {NUMBER: nan, TEXTS: []}


@dataclass(frozen=True)
class Each:
    """A mapping from any key, or from some, or from names of initializers, to values of one shape."""

    shape: Any
    keys: tuple[str, ...] = ()
    initializers: bool = False


def _numbers(*names: str) -> dict[str, str]:
    return dict.fromkeys(names, NUMBER)


_OF_INITIALIZERS = Each(NUMBER, initializers=True)
_JUDGED = _numbers("plausible", "unlikely", "wrong")
#: The shape of ``values.yaml``: a number that it leaves out is null, and so is all within a part that it leaves out.
VALUES: dict[str, Any] = {
    "graph": _numbers("relations", "entities", "concepts", "affordance", "material", "bowls_in_cabinets",
                      "observations", "unique_triples") | {"median_per_environment": Each(Each(NUMBER))},
    "training": _numbers("dimension", "ratio", "learning_rate", "weight_decay"),
    "settings": _numbers("repeats", "largest_size", "curve_size", "margin", "max_epochs", "finetuning_rate",
                         "candidates") | {
        "shares": _numbers("smallest", "largest"),
        "transfer": _numbers("candidates", "size", "min_observations", "repeats"),
    },
    "indicators": _OF_INITIALIZERS,
    "indicators_degrade_after": NUMBER,
    "indicators_rule": _numbers("neighbours", "epochs", "points"),
    "immediate": {"improvement_over_xavier": _OF_INITIALIZERS, "improvement_in_the_abstract": NUMBER},
    "convergence": {
        "epochs": Each(_numbers("mean", "deviation"), initializers=True),
        "fewer_epochs_than_xavier": _OF_INITIALIZERS,
    },
    "transfer": dict.fromkeys(("all_queries", "novel_queries", "epochs", "drop"), _OF_INITIALIZERS),
    "affordances": _numbers("isi", "xavier") | {"judged": {"isi": _JUDGED, "xavier": _JUDGED}},
}  # fmt: skip
#: The shape of ``vocabulary.yaml``.
VOCABULARY: dict[str, Any] = {
    "relations": Each(TEXT), "kinds": TEXTS, "concepts": TEXTS, "afforded": Each(TEXTS),
    "bowls_in_cabinets": Each(TEXTS, keys=("head", "relation", "tail")),
}  # fmt: skip


def read(path: Path) -> dict[str, Any]:
    """The paper's numbers.

    Raises:
        InputError: where the file is missing or no YAML, or has something unknown or of another type.
    """
    found: dict[str, Any] = _checked(config.read(path), VALUES, "", path)
    return found


def read_vocabulary(path: Path) -> dict[str, Any]:
    """The paper's words, from the file beside that of its numbers; raises likewise."""
    path = path.with_name("vocabulary.yaml")
    found: dict[str, Any] = _checked(config.read(path), VOCABULARY, "", path)
    return found


def empty(shape: Any) -> Any:
    """What a file has that leaves everything out."""
    return _checked(None, shape, "", Path())


def _checked(value: Any, shape: Any, place: str, path: Path) -> Any:
    """A value of a shape, with null for the numbers that it lacks."""
    if isinstance(shape, str):
        if value is None and shape in _MISSING:
            return _MISSING[shape]
        if not _is_leaf(value, shape):
            raise InputError(path, place, f"expected {shape}, got {value!r:.80}")
        return value
    if not isinstance(value, dict | None):
        raise InputError(path, place, f"expected a mapping of keys to values, got {value!r:.80}")
    given = value or {}
    for key in given:
        _check_key(key, shape, f"{place}.{key}".lstrip("."), path)
    inner = shape if isinstance(shape, dict) else {key: shape.shape for key in given if given[key] is not None}
    return {key: _checked(given.get(key), of, f"{place}.{key}".lstrip("."), path) for key, of in inner.items()}


def _is_leaf(value: Any, shape: str) -> bool:
    if shape == NUMBER:
        return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    texts = value if shape == TEXTS else [value]
    return isinstance(texts, list) and bool(texts) and all(isinstance(text, str) for text in texts)


def _check_key(key: Any, shape: dict[str, Any] | Each, place: str, path: Path) -> None:
    keys = shape.keys if isinstance(shape, Each) else tuple(shape)
    if not isinstance(key, str) or (keys and key not in keys):
        raise InputError(path, place, f"expected {'one of ' + ', '.join(keys) if keys else 'text as a key'}")
    if isinstance(shape, Each) and shape.initializers:
        try:
            registered(key)
        except InputError as error:
            raise InputError(path, place, "expected the name of an initializer") from error
