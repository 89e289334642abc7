"""What the paper states and how it calls things, as files of ``data/raw/paper`` have it: any part may be missing."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from isi import config
from isi.config import Section
from isi.errors import InputError
from isi.report.models import registered

#: Null where it is not stated.
Number = int | float


def _initializer(name: str) -> str:
    try:
        registered(name)
    except InputError as error:
        raise ValueError("expected the name of an initializer") from error
    return name


#: By initializer; those that are not stated are left out.
Numbers = dict[Annotated[str, AfterValidator(_initializer)], Number]


class _Graph(Section):
    relations: Number = nan
    entities: Number = nan
    concepts: Number = nan
    affordance: Number = nan
    material: Number = nan
    bowls_in_cabinets: Number = nan
    observations: Number = nan
    unique_triples: Number = nan
    median_per_environment: dict[str, dict[str, Number]] = Field(default_factory=dict)


class _Training(Section):
    dimension: Number = nan
    ratio: Number = nan
    learning_rate: Number = nan
    weight_decay: Number = nan


class _Shares(Section):
    smallest: Number = nan
    largest: Number = nan


class _Inserted(Section):
    candidates: Number = nan
    size: Number = nan
    min_observations: Number = nan
    repeats: Number = nan


class _Settings(Section):
    repeats: Number = nan
    largest_size: Number = nan
    shares: _Shares = _Shares()
    curve_size: Number = nan
    margin: Number = nan
    max_epochs: Number = nan
    finetuning_rate: Number = nan
    candidates: Number = nan
    transfer: _Inserted = _Inserted()


class _Rule(Section):
    neighbours: Number = nan
    epochs: Number = nan
    points: Number = nan


class _Immediate(Section):
    improvement_over_xavier: Numbers = Field(default_factory=dict)
    improvement_in_the_abstract: Number = nan


class _Epochs(Section):
    mean: Number = nan
    deviation: Number = nan


class _Convergence(Section):
    epochs: dict[Annotated[str, AfterValidator(_initializer)], _Epochs] = Field(default_factory=dict)
    fewer_epochs_than_xavier: Numbers = Field(default_factory=dict)


class _Transfer(Section):
    all_queries: Numbers = Field(default_factory=dict)
    novel_queries: Numbers = Field(default_factory=dict)
    epochs: Numbers = Field(default_factory=dict)
    drop: Numbers = Field(default_factory=dict)


class _Judged(Section):
    plausible: Number = nan
    unlikely: Number = nan
    wrong: Number = nan


class _BothJudged(Section):
    isi: _Judged = _Judged()
    xavier: _Judged = _Judged()


class _Affordances(Section):
    isi: Number = nan
    xavier: Number = nan
    judged: _BothJudged = _BothJudged()


class Paper(Section):
    """``values.yaml``."""

    graph: _Graph = _Graph()
    training: _Training = _Training()
    settings: _Settings = _Settings()
    indicators: Numbers = Field(default_factory=dict)
    indicators_degrade_after: Number = nan
    indicators_rule: _Rule = _Rule()
    immediate: _Immediate = _Immediate()
    convergence: _Convergence = _Convergence()
    transfer: _Transfer = _Transfer()
    affordances: _Affordances = _Affordances()


class Vocabulary(Section):
    """``vocabulary.yaml``."""

    relations: dict[str, str] = Field(default_factory=dict)
    kinds: list[str] = Field(default_factory=list)
    concepts: list[str] = Field(default_factory=list)
    bowls_in_cabinets: dict[Literal["head", "relation", "tail"], Annotated[list[str], Field(min_length=1)]] = Field(
        default_factory=dict
    )
    afforded: dict[str, list[str]] = Field(default_factory=dict)


def read(path: Path, kind: type[Section]) -> dict[str, Any]:
    """A file, with null for numbers that it does not state.

    Raises:
        InputError: where it is missing or no YAML, or has something that is unknown or of another type.
    """
    return config.check(_without_null(config.read(path)), kind, "", path).model_dump()


def _without_null(values: Any) -> Any:
    """The same without what has a name and no value."""
    if not isinstance(values, dict):
        return values
    return {key: _without_null(value) for key, value in values.items() if value is not None}
