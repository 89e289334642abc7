"""Everything that a report is made of, read from the pipeline's tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd

from isi.analyses import single_insertions
from isi.analyses.affordances import AFFORDANCES
from isi.analyses.cross_validation import CROSS_VALIDATION
from isi.analyses.finetune_only import FINETUNE_ONLY
from isi.analyses.model_comparison import MODEL_COMPARISON
from isi.analyses.query_breakdown import QUERY_BREAKDOWN, USED_COORDINATES
from isi.analyses.sweep import INDICATOR_SWEEP, RATE_SWEEP
from isi.analyses.trajectory import TRACED, TRAJECTORY
from isi.experiment.insert import is_listed
from isi.experiment.tables import INSERTED, RUNS, TIES, TRAINING_LOG
from isi.graph.graph import MinedSource
from isi.graph.tables import COVERAGE, ENTITIES, INSERT_TRIPLES, NOVEL, SPLITS, TRIPLES
from isi.params import ExperimentOf, Params
from isi.report import stated, varied
from isi.report.models import JOINT
from isi.report.statistics import converged
from isi.report.varied import Explored, Varied
from isi.sources.readers import read_batches
from isi.sources.tables import KINDS, MINED, OBSERVATIONS
from isi.tables import paths
from isi.tables.table import Table


@dataclass(frozen=True, eq=False)
class Experiment:
    """The tables of one experiment, with entities by id where the tables have ids."""

    name: str
    #: behind names of tables and figures; none for the first experiment
    suffix: str
    params: Params
    #: of the experiment
    initializers: list[str]
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
    def how(self) -> ExperimentOf:
        """What the params say of it."""
        return self.params.experiments[self.name]

    @property
    def title(self) -> str:
        return self.how.title

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    @property
    def finetuned(self) -> list[str]:
        """The initializers that are not measured at once alone."""
        return [name for name in self.initializers if name not in self.how.immediate_only]

    @cached_property
    def at_once(self) -> pd.DataFrame:
        """Runs before any further training."""
        return self.runs[self.runs["epoch"] == 0]

    @property
    def curve_size(self) -> int | None:
        """The first size that is followed to the end and was run: the one whose curves are drawn."""
        return next((size for size in self.how.full_curves.sizes if size in self.how.sessions.sizes), None)

    @property
    def curves(self) -> pd.DataFrame:
        """Runs of that size by those who are followed, and of the joint model."""
        followed = [name for name in self.finetuned if is_listed(self.how.full_curves.initializers, name)]
        return self.runs[(self.runs["size"] == self.curve_size) & self.runs["model"].isin([*followed, JOINT])]

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer that is fine-tuned, and each cell (see ``converged``)."""
        return self.converged(self.runs[self.runs["model"].isin(self.finetuned)], ["model"])

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """Epochs to convergence of runs that ``by`` tells apart (``statistics.converged``)."""
        joint, how = self.runs[self.runs["model"] == JOINT], self.params
        return converged(runs, joint, how.convergence.margin, how.finetuning.max_epochs, by)


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Study(Generic[T]):
    """What was found beside the runs of one experiment: the first that params list for the study."""

    experiment: Experiment
    found: T


@dataclass(frozen=True, eq=False)
class Asked:
    """What every model of an experiment was asked right after insertion, and what the joint model is made of."""

    #: ``tables.ASKED``
    queries: pd.DataFrame
    #: ``tables.USED``
    used: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Results:
    """The experiments that were run, and all that stands beside them; what was not run is None."""

    params: Params
    #: what was run, by title: mappings of names to values
    run: Mapping[str, Mapping[str, Any]]
    #: the paper's numbers, and what it calls things (``stated.Paper``, ``stated.Vocabulary``)
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any]
    #: columns phrase and definition
    definitions: pd.DataFrame
    #: by name, in the order of the params
    experiments: Mapping[str, Experiment]
    #: what each source observed that the experiments draw on, and what mining it left (``tables.MINED``)
    seen: Mapping[str, MinedSource]
    mined: Mapping[str, pd.DataFrame]
    #: by experiment
    asking: Mapping[str, Asked] = field(default_factory=dict)
    #: by experiment, ``tables.RUNS`` of Θ⁰ trained on with nothing inserted
    nothing: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    #: what lies beyond the paper, by variant; empty where the second pipeline has not run
    beyond: Mapping[str, Varied] = field(default_factory=dict)
    #: graphs of the second pipeline, likewise
    explored: Mapping[str, Explored] = field(default_factory=dict)
    #: ``tables.AFFORDANCES`` with the initializer as ``model``
    affordances: Study[pd.DataFrame] | None = None
    #: ``tables.INDICATOR_SWEEP`` and ``tables.RATE_SWEEP`` of each initializer, told apart by a column ``model``
    sweep: Study[pd.DataFrame] | None = None
    rates: Study[pd.DataFrame] | None = None
    #: ``tables.CROSS_VALIDATION``
    cross_validation: Study[pd.DataFrame] | None = None
    #: ``tables.FAMILIES`` of each, told apart by a column ``family``
    families: Study[pd.DataFrame] | None = None
    #: what became of one novel entity (see ``tracing.Trace``), by name
    approach: Study[Mapping[str, np.ndarray]] | None = None
    #: the tables of single insertions, by name (``singles.TABLES``)
    explorer: Study[Mapping[str, pd.DataFrame]] | None = None

    @property
    def own(self) -> list[Experiment]:
        """Experiments whose entities are all of one graph of their own."""
        return [one for one in self.experiments.values() if one.how.graph.extend is None]

    @property
    def extended(self) -> list[Experiment]:
        """Experiments that insert entities of another source."""
        return [one for one in self.experiments.values() if one.how.graph.extend is not None]

    def source_title(self, source: str) -> str:
        """What people call a source: the experiment with its graph."""
        return next((one.title for one in self.own if one.how.graph.source == source), source)


def read(params: Params, run: Mapping[str, Mapping[str, Any]]) -> Results:
    """Read the tables of all experiments, and of the studies of one of them.

    Raises:
        InputError: where one is missing or broken.
    """
    paper = stated.read(paths.PAPER, stated.Paper)
    vocabulary = stated.read(paths.PAPER.with_name("vocabulary.yaml"), stated.Vocabulary)
    experiments = {name: _experiment(params, name) for name in params.experiments}
    graphs = [one.graph for one in params.experiments.values()]
    sources = dict.fromkeys([*(one.source for one in graphs), *(one.extend.source for one in graphs if one.extend)])
    return Results(
        params=params,
        run=run,
        paper=paper,
        vocabulary=vocabulary,
        definitions=read_definitions(paths.DEFINITIONS),
        experiments=experiments,
        seen={name: _seen(name) for name in sources},
        mined={name: MINED.read_text(source=name) for name in sources},
        asking={name: _asked(name) for name in params.query_breakdown.experiments},
        beyond=varied.read(experiments, params),
        explored=varied.explored(params),
        nothing={name: FINETUNE_ONLY.read_text(experiment=name) for name in params.finetune_only.experiments},
        **_studies(params, experiments),
    )


def _studies(params: Params, experiments: Mapping[str, Experiment]) -> dict[str, Study[Any]]:
    """The studies that were run, by the names that ``Results`` has for them."""
    asked: dict[str, tuple[list[str], Callable[[str], Any]]] = {
        "affordances": (params.affordances.experiments, _affordances),
        "sweep": (params.sweep.experiments, partial(_sweep, params.sweep.initializers)),
        "rates": (params.rate_sweep.experiments, partial(_rates, params)),
        "cross_validation": (params.cross_validation.experiments, _cross_validation),
        "families": (params.compare_models.experiments, partial(_families, params.compare_models.models)),
        "approach": (params.trajectory.experiments, _approach),
        "explorer": (params.explorer.experiments, _explorer),
    }
    first = {study: (listed[0], read) for study, (listed, read) in asked.items() if listed}
    return {study: Study(experiments[name], read(name)) for study, (name, read) in first.items()}


def _experiment(params: Params, name: str) -> Experiment:
    initializers = params.initializers_of(name)
    return Experiment(
        name=name,
        suffix="" if name == next(iter(params.experiments)) else f"_{name}",
        params=params,
        initializers=initializers,
        entities=ENTITIES.read_text(experiment=name),
        triples=TRIPLES.read_text(experiment=name),
        coverage=COVERAGE.read_text(experiment=name),
        splits=SPLITS.read_text(experiment=name),
        novel=NOVEL.read_text(experiment=name),
        insert_triples=INSERT_TRIPLES.read_text(experiment=name),
        theta0_log=TRAINING_LOG.read_text(experiment=name, model="theta0"),
        joint_log=TRAINING_LOG.read_text(experiment=name, model=JOINT),
        runs=_of_each(RUNS, name, [*initializers, JOINT]),
        inserted=_of_each(INSERTED, name, initializers, "initializer"),
        ties=_of_each(TIES, name, [*initializers, JOINT]),
    )


def _seen(source: str) -> MinedSource:
    return MinedSource(source, OBSERVATIONS.read_text(source=source), KINDS.read_text(source=source))


def _affordances(experiment: str) -> pd.DataFrame:
    return AFFORDANCES.read_text(experiment=experiment).rename(columns={"initializer": "model"})


def _asked(experiment: str) -> Asked:
    return Asked(QUERY_BREAKDOWN.read_text(experiment=experiment), USED_COORDINATES.read_text(experiment=experiment))


def _sweep(initializers: Iterable[str], experiment: str) -> pd.DataFrame:
    return _of_each(INDICATOR_SWEEP, experiment, initializers, "initializer")


def _rates(params: Params, experiment: str) -> pd.DataFrame:
    return _of_each(RATE_SWEEP, experiment, params.rate_sweep.initializers, "initializer")


def _cross_validation(experiment: str) -> pd.DataFrame:
    return CROSS_VALIDATION.read_text(experiment=experiment)


def _families(families: Iterable[str], experiment: str) -> pd.DataFrame:
    return _of_each(MODEL_COMPARISON, experiment, families, column="family")


def _of_each(
    table: Table, experiment: str, names: Iterable[str], slot: str = "model", column: str = "model"
) -> pd.DataFrame:
    """The tables of some models, by the slot of the path that names them, one after the other."""
    return pd.concat(table.read_text(experiment=experiment, **{slot: name}).assign(**{column: name}) for name in names)


def _approach(experiment: str) -> Mapping[str, np.ndarray]:
    of_each = [f"{model}.{what}" for model in TRACED for what in ("path", "indicators")]
    tensors = TRAJECTORY.read(["entity", "known", "theta0", *of_each], experiment=experiment)
    return {name: tensor.numpy() for name, tensor in tensors.items()}


def _explorer(experiment: str) -> Mapping[str, pd.DataFrame]:
    return {what: table.read_text(experiment=experiment) for what, (table, _) in single_insertions.TABLES.items()}


def read_definitions(path: Path) -> pd.DataFrame:
    """What phrases mean: columns phrase and definition."""
    columns = ["phrase", "definition"]
    return pd.concat(
        [pd.DataFrame(columns=columns, dtype=str), *read_batches(path, columns, others=True)], ignore_index=True
    )
