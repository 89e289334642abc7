"""The pipeline's tables as the report reads them: experiments, analyses of them, and what lies beyond the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
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
from isi.report import paper_values, variants
from isi.report.models import JOINT
from isi.report.stats import converged
from isi.report.variants import OtherGraph, VariantRuns
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
    #: ``tables.RUNS`` of every initializer and of the joint model, with a column ``model``
    runs: pd.DataFrame
    #: ``tables.INSERTED`` and ``tables.TIES``, likewise
    inserted: pd.DataFrame
    ties: pd.DataFrame

    @property
    def settings(self) -> ExperimentOf:
        """Its entry in params."""
        return self.params.experiments[self.name]

    @property
    def title(self) -> str:
        return self.settings.title

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    @property
    def finetuned(self) -> list[str]:
        """The initializers whose entities are fine-tuned after insertion."""
        return [name for name in self.initializers if name not in self.settings.immediate_only]

    @cached_property
    def immediate(self) -> pd.DataFrame:
        """Runs right after insertion, before any further training."""
        return self.runs[self.runs["epoch"] == 0]

    @property
    def curve_size(self) -> int | None:
        """The first size that was run and has full learning curves."""
        settings = self.settings
        return next((size for size in settings.full_curves.sizes if size in settings.sessions.sizes), None)

    @property
    def curves(self) -> pd.DataFrame:
        """Runs of that size by the initializers with full curves, and of the joint model."""
        names = [name for name in self.finetuned if is_listed(self.settings.full_curves.initializers, name)]
        return self.runs[(self.runs["size"] == self.curve_size) & self.runs["model"].isin([*names, JOINT])]

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer that is fine-tuned, and each cell (see ``converged``)."""
        return self.converged(self.runs[self.runs["model"].isin(self.finetuned)], ["model"])

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """Epochs to convergence of runs that the columns ``by`` distinguish (``stats.converged``)."""
        joint, params = self.runs[self.runs["model"] == JOINT], self.params
        return converged(runs, joint, params.convergence.margin, params.finetuning.max_epochs, by)


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Analysis(Generic[T]):
    """The result of an analysis of one experiment: the first that params list for it."""

    experiment: Experiment
    result: T


@dataclass(frozen=True, eq=False)
class BreakdownTables:
    """MRR* of all models of an experiment by kind of query, right after insertion, and the joint model's make-up."""

    #: ``tables.ASKED``
    queries: pd.DataFrame
    #: ``tables.USED``
    used: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Results:
    """The experiments that were run and the analyses of them; what was not run is None."""

    params: Params
    #: params, versions and hashes, by title: mappings of names to values
    run: Mapping[str, Mapping[str, Any]]
    #: the paper's numbers, and what it calls things (``paper_values``)
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any]
    #: columns phrase and definition
    definitions: pd.DataFrame
    #: by name, in the order of the params
    experiments: Mapping[str, Experiment]
    #: by source: its observations, and what mining it left (``tables.MINED``)
    observed: Mapping[str, MinedSource]
    mined: Mapping[str, pd.DataFrame]
    #: by experiment
    query_breakdown: Mapping[str, BreakdownTables] = field(default_factory=dict)
    #: by experiment, ``tables.RUNS`` of Θ⁰ trained on without any insertion
    finetune_only: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    #: of the second pipeline, by name; empty where it has not run
    variants: Mapping[str, VariantRuns] = field(default_factory=dict)
    other_graphs: Mapping[str, OtherGraph] = field(default_factory=dict)
    #: ``tables.AFFORDANCES`` with the initializer as ``model``
    affordances: Analysis[pd.DataFrame] | None = None
    #: ``tables.INDICATOR_SWEEP`` and ``tables.RATE_SWEEP`` of each initializer, with a column ``model``
    sweep: Analysis[pd.DataFrame] | None = None
    rate_sweep: Analysis[pd.DataFrame] | None = None
    #: ``tables.CROSS_VALIDATION``
    cross_validation: Analysis[pd.DataFrame] | None = None
    #: ``tables.FAMILIES`` of each embedding model, with a column ``family``
    embedding_models: Analysis[pd.DataFrame] | None = None
    #: the way of one novel entity (see ``tracing.Trace``), by name
    trajectory: Analysis[Mapping[str, np.ndarray]] | None = None
    #: the tables of single insertions, by name (``singles.TABLES``)
    explorer: Analysis[Mapping[str, pd.DataFrame]] | None = None

    @property
    def standalone(self) -> list[Experiment]:
        """Experiments whose entities are all of one graph of their own."""
        return [one for one in self.experiments.values() if one.settings.graph.extend is None]

    @property
    def extended(self) -> list[Experiment]:
        """Experiments that insert entities of another source."""
        return [one for one in self.experiments.values() if one.settings.graph.extend is not None]

    def source_title(self, source: str) -> str:
        """What people call a source: the experiment with its graph."""
        return next((one.title for one in self.standalone if one.settings.graph.source == source), source)

    @property
    def titles(self) -> dict[str, str]:
        """What people call the experiments."""
        return {name: experiment.title for name, experiment in self.experiments.items()}


def read(params: Params, run: Mapping[str, Mapping[str, Any]]) -> Results:
    """Read the tables of all experiments and analyses.

    Raises:
        InputError: where one is missing or broken.
    """
    paper, vocabulary = paper_values.read(paths.PAPER), paper_values.read_vocabulary(paths.PAPER)
    experiments = {name: _experiment(params, name) for name in params.experiments}
    graphs = [entry.graph for entry in params.experiments.values()]
    sources = dict.fromkeys(part.source for graph in graphs for part in (graph, graph.extend) if part)
    return Results(
        params=params, run=run, paper=paper, vocabulary=vocabulary, experiments=experiments,
        definitions=read_definitions(paths.DEFINITIONS),
        observed={name: MinedSource(name, OBSERVATIONS.read_text(source=name), KINDS.read_text(source=name))
                  for name in sources},
        mined={name: MINED.read_text(source=name) for name in sources},
        query_breakdown={name: BreakdownTables(QUERY_BREAKDOWN.read_text(experiment=name),
                                              USED_COORDINATES.read_text(experiment=name))
                         for name in params.query_breakdown.experiments},
        variants=variants.read(experiments, params), other_graphs=variants.read_other_graphs(params),
        finetune_only={name: FINETUNE_ONLY.read_text(experiment=name) for name in params.finetune_only.experiments},
        **_analyses(params, experiments),
    )  # fmt: skip


def _experiment(params: Params, name: str) -> Experiment:
    initializers = params.initializers_of(name)
    models = [*initializers, JOINT]
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
        runs=_of_each(RUNS, name, models),
        inserted=_of_each(INSERTED, name, initializers, "initializer"),
        ties=_of_each(TIES, name, models),
    )


def _analyses(params: Params, experiments: Mapping[str, Experiment]) -> dict[str, Analysis[Any]]:
    """The analyses that were run, by the names that ``Results`` has for them: each of the first experiment listed."""
    sweep, rates, models = params.sweep, params.rate_sweep, params.compare_models
    readers: dict[str, tuple[list[str], Callable[[str], Any]]] = {
        "affordances": (params.affordances.experiments, lambda name: AFFORDANCES.read_text(experiment=name).rename(
            columns={"initializer": "model"})),
        "sweep": (sweep.experiments, lambda name: _of_each(INDICATOR_SWEEP, name, sweep.initializers, "initializer")),
        "rate_sweep": (rates.experiments, lambda name: _of_each(RATE_SWEEP, name, rates.initializers, "initializer")),
        "cross_validation": (params.cross_validation.experiments, lambda name: CROSS_VALIDATION.read_text(
            experiment=name)),
        "embedding_models": (models.experiments, lambda name: _of_each(
            MODEL_COMPARISON, name, models.models, column="family")),
        "trajectory": (params.trajectory.experiments, _trajectory),
        "explorer": (params.explorer.experiments, lambda name: {
            part: table.read_text(experiment=name) for part, (table, _) in single_insertions.TABLES.items()}),
    }  # fmt: skip
    return {name: Analysis(experiments[listed[0]], reader(listed[0]))
            for name, (listed, reader) in readers.items() if listed}  # fmt: skip


def _trajectory(experiment: str) -> Mapping[str, np.ndarray]:
    of_each = [f"{model}.{part}" for model in TRACED for part in ("path", "indicators")]
    tensors = TRAJECTORY.read(["entity", "known", "theta0", *of_each], experiment=experiment)
    return {name: tensor.numpy() for name, tensor in tensors.items()}


def _of_each(
    table: Table, experiment: str, names: Iterable[str], slot: str = "model", column: str = "model"
) -> pd.DataFrame:
    """The tables of some models, by the slot of the path that names them, one after the other."""
    return pd.concat(table.read_text(experiment=experiment, **{slot: name}).assign(**{column: name}) for name in names)


def read_definitions(path: Path) -> pd.DataFrame:
    """What phrases mean: columns phrase and definition."""
    columns = ["phrase", "definition"]
    parts = read_batches(path, columns, others=True)
    return pd.concat([pd.DataFrame(columns=columns, dtype=str), *parts], ignore_index=True)
