"""Everything that a report is made of, read from the pipeline's tables."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from isi import convergence, paths, tables
from isi.errors import InputError
from isi.experiments.tracing import TRACED
from isi.params import MP3D, Params
from isi.scenes import mp3d

JOINT = "joint"
#: The paper's, whose indicator set size is varied.
ISI = ("es", "rs", "ers")


@dataclass(frozen=True, eq=False)
class Experiment:
    """The tables of one experiment, with entities by id where the tables have ids."""

    params: Params
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
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell (see ``converged``)."""
        return self.converged(self.runs[self.runs["model"] != JOINT], ["model"])

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """Epochs to convergence of runs that ``by`` tells apart (``convergence.epochs_to_convergence``)."""
        joint, margin = self.runs[self.runs["model"] == JOINT], self.params.convergence.margin
        return convergence.epochs_to_convergence(runs, joint, margin, self.params.finetuning.max_epochs, by)


@dataclass(frozen=True, eq=False)
class Results(Experiment):
    """The tables of the main experiment, and all that stands beside it."""

    paper: Mapping[str, Any]
    definitions: pd.DataFrame
    #: from AI2-THOR to Matterport3D
    transfer: Experiment
    #: instances of Matterport3D that are left after each step of mining, where tallies are its source
    mined: Mapping[str, int]
    #: ``tables.AFFORDANCES`` of every initializer, told apart by a column ``model``
    affordances: pd.DataFrame
    #: ``tables.INDICATOR_SWEEP`` and ``tables.RATE_SWEEP``, likewise
    sweep: pd.DataFrame
    rates: pd.DataFrame
    cross_validation: pd.DataFrame
    #: what became of one novel entity (see ``tracing.Trace``), by name
    approach: Mapping[str, np.ndarray]

    @property
    def experiments(self) -> dict[str, Experiment]:
        """Both, by name."""
        return {"ai2thor": self, "transfer": self.transfer}

    @cached_property
    def curve_size(self) -> int | None:
        """The first of ``curves.sizes`` that was run: the one that is drawn."""
        return next((size for size in self.params.curves.sizes if size in self.params.sessions.sizes), None)

    @cached_property
    def sweep_convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer, indicator set size and cell."""
        return self.converged(self.sweep, ["model", "k"])


def read(params: Params) -> Results:
    """Read the tables of all experiments.

    Raises:
        InputError: where one is missing or broken.
    """
    main, initializers = "ai2thor", params.insert.initializers
    return Results(
        **vars(_experiment(params, main, main)),
        paper=_read_paper(paths.PAPER),
        definitions=_read_definitions(paths.DEFINITIONS),
        transfer=_experiment(params, "transfer", "mp3d"),
        mined=_mined(params.mp3d),
        affordances=_of_models(partial(paths.affordances, "transfer"), tables.AFFORDANCES, initializers),
        sweep=_of_models(paths.indicator_sweep, tables.INDICATOR_SWEEP, ISI),
        rates=_table(paths.rate_sweep(), tables.RATE_SWEEP).rename(columns={"initializer": "model"}),
        cross_validation=_table(paths.cross_validation(main), tables.CROSS_VALIDATION),
        approach=_read_approach(paths.approach(main)),
    )


def _experiment(params: Params, name: str, source: str) -> Experiment:
    initializers = params.insert.initializers
    return Experiment(
        params=params,
        observations=_table(paths.observations(source), tables.OBSERVATIONS),
        entities=_table(paths.entities(name), tables.ENTITIES),
        triples=_table(paths.triples(name), tables.TRIPLES),
        coverage=_table(paths.coverage(name), tables.COVERAGE),
        splits=_table(paths.splits(name), tables.SPLITS),
        novel=_table(paths.novel(name), tables.NOVEL),
        insert_triples=_table(paths.insert_triples(name), tables.INSERT_TRIPLES),
        theta0_log=_table(paths.training_log(name, "theta0"), tables.TRAINING_LOG),
        joint_log=_table(paths.training_log(name, JOINT), tables.TRAINING_LOG),
        runs=_of_models(partial(paths.runs, name), tables.RUNS, [*initializers, JOINT]),
        inserted=_of_models(partial(paths.inserted, name), tables.INSERTED, initializers),
        ties=_of_models(partial(paths.ties, name), tables.TIES, [*initializers, JOINT]),
    )


def _table(path: Path, schema: pa.Schema) -> pd.DataFrame:
    frame = tables.read(path, schema)
    names = frame.select_dtypes("category").columns
    return frame.astype(dict.fromkeys(names, str))


def _of_models(path: Callable[[str], Path], schema: pa.Schema, models: Sequence[str]) -> pd.DataFrame:
    return pd.concat(_table(path(model), schema).assign(model=model) for model in models)


def _mined(how: MP3D) -> Mapping[str, int]:
    left: Counter[str] = Counter()
    if how.source == "tallies":
        words = mp3d.Vocabulary(how.rooms.tallies, how.structure, how.same_as)
        deque(mp3d.mine([mp3d.tallies(paths.MP3D_TALLIES, how.rooms.tallies)], words, left), maxlen=0)
    return left


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
