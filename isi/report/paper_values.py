"""The paper's numbers and words, from files of ``data/raw/paper``,
in which any part may be missing.
"""

from math import nan
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, create_model

from isi import config
from isi.errors import InputError
from isi.report.words import label


def _without_null(values: Any) -> Any:
    return (
        {key: value for key, value in values.items() if value is not None}
        if isinstance(values, dict)
        else values
    )


def _initializer(name: str) -> str:
    try:
        label(name)
    except InputError as error:
        raise ValueError("expected the name of an initializer") from error
    return name


def _part(*numbers: str, **parts: Any) -> Any:
    """A type with fields ``numbers`` (default NaN) and ``parts`` (default empty);
    null means absent.
    """
    fields: dict[str, Any] = dict.fromkeys(numbers, (Number, nan))
    for name, kind in parts.items():
        empty = kind.__origin__
        fields[name] = (kind, Field(default_factory=getattr(empty, "__origin__", empty)))
    return Annotated[
        create_model("PaperPart", __base__=config.Section, **fields), BeforeValidator(_without_null)
    ]


def _mapping(key: Any, value: Any) -> Any:
    """The type of a mapping whose null values are dropped."""
    return Annotated[dict[key, value], BeforeValidator(_without_null)]


Number = int | float
Texts = Annotated[list[str], Field(min_length=1)]
Initializer = Annotated[str, AfterValidator(_initializer)]
_OF_INITIALIZERS, _JUDGED = _mapping(Initializer, Number), _part("plausible", "unlikely", "wrong")
#: The shape of ``values.yaml``.
VALUES = _part(
    "indicators_degrade_after",
    graph=_part(
        "relations",
        "entities",
        "concepts",
        "affordance",
        "material",
        "bowls_in_cabinets",
        "observations",
        "unique_triples",
        median_per_environment=_mapping(str, _mapping(str, Number)),
    ),
    training=_part("dimension", "ratio", "learning_rate", "weight_decay"),
    settings=_part(
        "repeats",
        "largest_size",
        "curve_size",
        "margin",
        "max_epochs",
        "finetuning_rate",
        "candidates",
        shares=_part("smallest", "largest"),
        transfer=_part("candidates", "size", "min_observations", "repeats"),
    ),
    indicators=_OF_INITIALIZERS,
    indicators_rule=_part("neighbours", "epochs", "points"),
    immediate=_part("improvement_in_the_abstract", improvement_over_xavier=_OF_INITIALIZERS),
    convergence=_part(
        epochs=_mapping(Initializer, _part("mean", "deviation")),
        fewer_epochs_than_xavier=_OF_INITIALIZERS,
    ),
    transfer=_part(
        **dict.fromkeys(("all_queries", "novel_queries", "epochs", "drop"), _OF_INITIALIZERS)
    ),
    affordances=_part(
        "isi",
        "xavier",
        judged=_part(isi=_JUDGED, xavier=_JUDGED),
        answers=_mapping(str, _mapping(str, Texts)),
    ),
)
#: The shape of ``vocabulary.yaml``.
VOCABULARY = _part(
    relations=_mapping(str, str),
    kinds=Texts,
    concepts=Texts,
    afforded=_mapping(str, Texts),
    bowls_in_cabinets=_mapping(Literal["head", "relation", "tail"], Texts),
)


def read(path: Path, shape: Any = VALUES) -> dict[str, Any]:
    """The paper's numbers, or its words (``VOCABULARY``);
    ``InputError`` for a file of another shape.
    """
    values: dict[str, Any] = config.check(config.read(path), shape, "", path).model_dump()
    return values
