"""Everything that a report is made of, read from the pipeline's tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from isi import convergence, paths, tables
from isi.errors import InputError
from isi.experiments.tracing import TRACED
from isi.params import Params

JOINT = "joint"
#: The paper's, whose indicator set size is varied.
ISI = ("es", "rs", "ers")


@dataclass(frozen=True)
class Results:
    """The tables of one experiment, with entities by id where the tables have ids."""

    params: Params
    paper: Mapping[str, Any]
    definitions: pd.DataFrame
    observations: pd.DataFrame
    entities: pd.DataFrame
    triples: pd.DataFrame
    coverage: pd.DataFrame
    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame
    theta0_log: pd.DataFrame
    joint_log: pd.DataFrame
    #: ``tables.RUNS`` of every initializer and of the joint model, told apart by a column ``model``
    runs: pd.DataFrame
    #: ``tables.INSERTED`` and ``tables.TIES``, likewise
    inserted: pd.DataFrame
    ties: pd.DataFrame
    #: ``tables.INDICATOR_SWEEP`` and ``tables.RATE_SWEEP``, likewise
    sweep: pd.DataFrame
    rates: pd.DataFrame
    cross_validation: pd.DataFrame
    #: what became of one novel entity (see ``tracing.Trace``), by name
    approach: Mapping[str, np.ndarray]

    @property
    def initializers(self) -> list[str]:
        return self.params.insert.initializers

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    @cached_property
    def at_once(self) -> pd.DataFrame:
        """Runs before any further training."""
        return self.runs[self.runs["epoch"] == 0]

    @cached_property
    def curve_size(self) -> int | None:
        """The first of ``curves.sizes`` that was run: the one that is drawn."""
        return next((size for size in self.params.curves.sizes if size in self.params.sessions.sizes), None)

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell (see ``converged``)."""
        return self.converged(self.runs[self.runs["model"] != JOINT], ["model"])

    @cached_property
    def sweep_convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer, indicator set size and cell."""
        return self.converged(self.sweep, ["model", "k"])

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """Epochs to convergence of runs that ``by`` tells apart (``convergence.epochs_to_convergence``)."""
        joint, margin = self.runs[self.runs["model"] == JOINT], self.params.convergence.margin
        return convergence.epochs_to_convergence(runs, joint, margin, self.params.finetuning.max_epochs, by)


def read(params: Params, experiment: str) -> Results:
    """Read the tables of an experiment.

    Raises:
        InputError: where one is missing or broken.
    """

    def table(path: Path, schema: Any) -> pd.DataFrame:
        frame = tables.read(path, schema)
        names = frame.select_dtypes("category").columns
        return frame.astype(dict.fromkeys(names, str))

    def of_models(path: Any, schema: Any, models: list[str]) -> pd.DataFrame:
        return pd.concat(table(path(experiment, model), schema).assign(model=model) for model in models)

    initializers = params.insert.initializers
    return Results(
        params=params,
        paper=_read_paper(paths.PAPER),
        definitions=_read_definitions(paths.DEFINITIONS),
        observations=table(paths.observations(experiment), tables.OBSERVATIONS),
        entities=table(paths.entities(experiment), tables.ENTITIES),
        triples=table(paths.triples(experiment), tables.TRIPLES),
        coverage=table(paths.coverage(experiment), tables.COVERAGE),
        splits=table(paths.splits(experiment), tables.SPLITS),
        novel=table(paths.novel(experiment), tables.NOVEL),
        insert_triples=table(paths.insert_triples(experiment), tables.INSERT_TRIPLES),
        theta0_log=table(paths.training_log(experiment, "theta0"), tables.TRAINING_LOG),
        joint_log=table(paths.training_log(experiment, JOINT), tables.TRAINING_LOG),
        runs=of_models(paths.runs, tables.RUNS, [*initializers, JOINT]),
        inserted=of_models(paths.inserted, tables.INSERTED, initializers),
        ties=of_models(paths.ties, tables.TIES, [*initializers, JOINT]),
        sweep=pd.concat(
            table(paths.indicator_sweep(model), tables.INDICATOR_SWEEP).assign(model=model) for model in ISI
        ),
        rates=table(paths.rate_sweep(), tables.RATE_SWEEP).rename(columns={"initializer": "model"}),
        cross_validation=table(paths.cross_validation(experiment), tables.CROSS_VALIDATION),
        approach=_read_approach(paths.approach(experiment)),
    )


def _read_approach(path: Path) -> Mapping[str, np.ndarray]:
    of_each = [f"{model}.{what}" for model in TRACED for what in ("path", "indicators")]
    tensors = tables.read_tensors(path, ["entity", "known", "theta0", *of_each])
    return {name: tensor.numpy() for name, tensor in tensors.items()}


def _read_paper(path: Path) -> Mapping[str, Any]:
    try:
        values: Mapping[str, Any] = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, YAMLError) as error:
        raise InputError(path, "", f"expected the paper's values in YAML ({error})") from error
    return values


def _read_definitions(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path, keep_default_na=False)[["phrase", "definition"]]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, "", f"expected a CSV file with columns phrase and definition ({error})") from error
