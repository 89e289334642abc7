"""The pipeline's tables as the report reads them: experiments, analyses of them, and what lies beyond the paper."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd

from isi.analyses import single_insertions
from isi.analyses.finetuning import FINETUNE_ONLY, INDICATOR_SWEEP, RATE_SWEEP
from isi.analyses.joint_models import CROSS_VALIDATION, MODEL_COMPARISON
from isi.analyses.query_breakdown import AFFORDANCES, QUERY_BREAKDOWN, USED_COORDINATES
from isi.analyses.single_insertions import TRACED, TRAJECTORY
from isi.analyses.variants import GRAPH_QUERIES, GRAPH_RUNS, VARIANT_QUERIES, VARIANT_RUNS, Variant
from isi.experiment.insert import is_listed
from isi.experiment.store import INSERTED, RUNS, TIES, TRAINING_LOG
from isi.graph.graph import ENTITIES, GRAPH_ENTITIES, GRAPH_TRIPLES, TRIPLES, MinedSource
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import COVERAGE
from isi.params import ExperimentOf, Params, load_beyond
from isi.report import paper_values
from isi.report.stats import by_direction, by_model, converged
from isi.report.tables import Estimate
from isi.report.words import JOINT
from isi.sources import KINDS, MINED, OBSERVATIONS
from isi.sources.readers import read_batches
from isi.tables import paths
from isi.tables.table import Table


@dataclass(frozen=True, eq=False)
class Experiment:
    """The tables of one experiment, with entities by id where the tables have ids."""

    name: str
    #: behind names of tables and figures; none for the first experiment
    suffix: str
    params: Params
    initializers: list[str]
    entities: pd.DataFrame
    triples: pd.DataFrame
    coverage: pd.DataFrame
    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame
    theta0_log: pd.DataFrame
    joint_log: pd.DataFrame
    #: of every initializer, runs and ties of the joint model, too: with a column ``model``
    runs: pd.DataFrame
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
        """Epochs to convergence of each initializer that is fine-tuned, session, size and seed."""
        return self.converged(self.runs[self.runs["model"].isin(self.finetuned)], ["model"])

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """Epochs to convergence of runs that the columns ``by`` distinguish (``stats.converged``)."""
        joint, params = self.runs[self.runs["model"] == JOINT], self.params
        return converged(runs, joint, params.convergence.margin, params.finetuning.max_epochs, by)


@dataclass(frozen=True, eq=False)
class VariantRuns:
    """The runs of a variant; they may be of fewer experiments and initializers than it lists by now."""

    variant: Variant
    #: ``VARIANT_RUNS`` and ``VARIANT_QUERIES``
    runs: pd.DataFrame
    queries: pd.DataFrame

    @property
    def title(self) -> str:
        return self.variant.title

    @cached_property
    def experiments(self) -> list[str]:
        """Those that ran, in the order of the variant."""
        ran = set(self.runs["experiment"])
        return [name for name in self.variant.experiments if name in ran]

    @cached_property
    def initializers(self) -> list[str]:
        """Those that ran, in the order of the variant."""
        ran = set(self.runs["model"])
        return [name for name in self.variant.initializers if name in ran]

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    def immediate(self, experiment: str, scope: str) -> pd.DataFrame:
        """Runs right after insertion."""
        runs = self.runs
        return runs[(runs["experiment"] == experiment) & (runs["scope"] == scope) & (runs["epoch"] == 0)]

    def given_in(self, experiment: str) -> pd.DataFrame:
        """The entity half of the queries that give the novel entity, by model, size and seed."""
        queries = by_direction(self.queries[self.queries["experiment"] == experiment], ["model", "size", "seed"])
        return queries[queries["scope"] == "given"]

    def max_epochs(self, params: Params) -> int:
        """Epochs of fine-tuning, at most."""
        return int(self.variant.changes.get("finetuning.max_epochs", params.finetuning.max_epochs))

    def convergence(self, experiment: str, params: Params) -> pd.DataFrame:
        """Epochs to convergence of each initializer, size and seed."""
        runs = self.runs[self.runs["experiment"] == experiment]
        joint, margin = runs["model"] == JOINT, params.convergence.margin
        return converged(runs[~joint], runs[joint], margin, self.max_epochs(params), ["model"])

    def immediate_means(self, experiment: str, scope: str) -> dict[str, Estimate]:
        """MRR* right after insertion by model."""
        return by_model(self.immediate(experiment, scope), "mrr_star", self.models)

    def given_means(self, experiment: str) -> dict[str, Estimate]:
        """The entity half of the queries that give the novel entity, by model."""
        return by_model(self.given_in(experiment), "mrr_star_entity", self.models)

    def epochs_means(self, experiment: str, params: Params) -> dict[str, Estimate]:
        """Epochs to convergence on held-out triples of the novel entities, by initializer."""
        epochs = self.convergence(experiment, params)
        return by_model(epochs[epochs["scope"] == "novel_heldout"], "epochs", self.initializers, scale=1)


@dataclass(frozen=True, eq=False)
class OtherGraph:
    """A graph of the second pipeline (``ENTITIES``, ``TRIPLES``), and the runs on it."""

    entities: pd.DataFrame
    triples: pd.DataFrame
    runs: VariantRuns


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Analysis(Generic[T]):
    """The result of an analysis of one experiment: the first that params list for it."""

    experiment: Experiment
    result: T


@dataclass(frozen=True, eq=False)
class BreakdownTables:
    """MRR* of all models of an experiment by kind of query, right after insertion, and the joint model's make-up."""

    queries: pd.DataFrame  # ``QUERY_BREAKDOWN``
    used: pd.DataFrame  # ``USED_COORDINATES``


@dataclass(frozen=True, eq=False)
class Results:
    """The experiments that were run and the analyses of them; what was not run is None."""

    params: Params
    #: params, versions and hashes, by title
    run: Mapping[str, Mapping[str, Any]]
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any]
    definitions: pd.DataFrame
    experiments: Mapping[str, Experiment]
    #: by source: its observations, and what mining it left (``MINED``)
    observed: Mapping[str, MinedSource]
    mined: Mapping[str, pd.DataFrame]
    #: by experiment; finetune_only: Θ⁰ trained on without any insertion
    query_breakdown: Mapping[str, BreakdownTables] = field(default_factory=dict)
    finetune_only: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    #: of the second pipeline
    variants: Mapping[str, VariantRuns] = field(default_factory=dict)
    other_graphs: Mapping[str, OtherGraph] = field(default_factory=dict)
    affordances: Analysis[pd.DataFrame] | None = None
    #: with the initializer as ``model``, like affordances
    sweep: Analysis[pd.DataFrame] | None = None
    rate_sweep: Analysis[pd.DataFrame] | None = None
    cross_validation: Analysis[pd.DataFrame] | None = None
    #: ``MODEL_COMPARISON`` of each embedding model, with a column ``family``
    embedding_models: Analysis[pd.DataFrame] | None = None
    #: tensors and tables by name
    trajectory: Analysis[Mapping[str, np.ndarray]] | None = None
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

    def variants_of(self, group: str) -> dict[str, VariantRuns]:
        """The variants of one group."""
        return {name: runs for name, runs in self.variants.items() if runs.variant.group == group}


def read(params: Params, run: Mapping[str, Mapping[str, Any]]) -> Results:
    """Read the tables of all experiments and analyses.

    Raises:
        InputError: where one is missing or broken.
    """
    paper = paper_values.read(paths.PAPER)
    vocabulary = paper_values.read(paths.PAPER.with_name("vocabulary.yaml"), paper_values.VOCABULARY)
    experiments = {name: _experiment(params, name) for name in params.experiments}
    graphs = [entry.graph for entry in params.experiments.values()]
    sources = dict.fromkeys(part.source for graph in graphs for part in (graph, graph.extend) if part)
    return Results(
        params=params, run=run, paper=paper, vocabulary=vocabulary, experiments=experiments,
        definitions=read_definitions(paths.DEFINITIONS),
        observed={name: MinedSource(name, OBSERVATIONS.read_text(source=name), KINDS.read_text(source=name))
                  for name in sources},
        mined={name: MINED.read_text(source=name) for name in sources},
        query_breakdown={name: BreakdownTables(*(table.read_text(experiment=name)
                                                for table in (QUERY_BREAKDOWN, USED_COORDINATES)))
                         for name in params.query_breakdown.experiments},
        variants=read_variants(experiments, params), other_graphs=_other_graphs(params),
        finetune_only={name: FINETUNE_ONLY.read_text(experiment=name) for name in params.finetune_only.experiments},
        **_analyses(params, experiments),
    )  # fmt: skip


def read_variants(experiments: Collection[str], params: Params) -> dict[str, VariantRuns]:
    """Every variant of the second pipeline that has run on any of the experiments, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    runs_of = {}
    for name, variant in load_beyond(params).variants.items():
        if VARIANT_QUERIES.path(variant=name).exists():
            frames = (VARIANT_RUNS.read_text(variant=name), VARIANT_QUERIES.read_text(variant=name))
            runs_of[name] = VariantRuns(variant, *(rows[rows["experiment"].isin(list(experiments))] for rows in frames))
    return {name: runs for name, runs in runs_of.items() if runs.experiments}


def _other_graphs(params: Params) -> dict[str, OtherGraph]:
    graphs = {name: graph.variant(name) for name, graph in load_beyond(params).graphs.items()
              if GRAPH_QUERIES.path(graph=name).exists()}  # fmt: skip
    tables = (GRAPH_ENTITIES, GRAPH_TRIPLES, GRAPH_RUNS, GRAPH_QUERIES)
    frames = {name: [table.read_text(graph=name) for table in tables] for name in graphs}
    return {name: OtherGraph(entities, triples, VariantRuns(graphs[name], runs, queries))
            for name, (entities, triples, runs, queries) in frames.items()}  # fmt: skip


def _experiment(params: Params, name: str) -> Experiment:
    models = [*(initializers := params.initializers_of(name)), JOINT]
    tables = {"entities": ENTITIES, "triples": TRIPLES, "coverage": COVERAGE, "splits": SPLITS, "novel": NOVEL,
              "insert_triples": INSERT_TRIPLES}  # fmt: skip
    return Experiment(
        name=name, suffix="" if name == next(iter(params.experiments)) else f"_{name}", params=params,
        initializers=initializers, **{part: table.read_text(experiment=name) for part, table in tables.items()},
        theta0_log=TRAINING_LOG.read_text(experiment=name, model="theta0"),
        joint_log=TRAINING_LOG.read_text(experiment=name, model=JOINT), runs=_of_each(RUNS, name, models),
        inserted=_of_each(INSERTED, name, initializers, "initializer"), ties=_of_each(TIES, name, models),
    )  # fmt: skip


def _analyses(params: Params, experiments: Mapping[str, Experiment]) -> dict[str, Analysis[Any]]:
    """The analyses that were run, by the names that ``Results`` has for them: each of the first experiment listed."""
    sweep, rates, models = params.sweep, params.rate_sweep, params.compare_models
    traced = ["entity", "known", "theta0", *(f"{model}.{part}" for model in TRACED for part in ("path", "indicators"))]
    readers: dict[str, tuple[list[str], Callable[[str], Any]]] = {
        "affordances": (params.affordances.experiments,
                        lambda name: AFFORDANCES.read_text(experiment=name).rename(columns={"initializer": "model"})),
        "sweep": (sweep.experiments, lambda name: _of_each(INDICATOR_SWEEP, name, sweep.initializers, "initializer")),
        "rate_sweep": (rates.experiments, lambda name: _of_each(RATE_SWEEP, name, rates.initializers, "initializer")),
        "cross_validation": (params.cross_validation.experiments,
                             lambda name: CROSS_VALIDATION.read_text(experiment=name)),
        "embedding_models": (models.experiments,
                             lambda name: _of_each(MODEL_COMPARISON, name, models.models, column="family")),
        "trajectory": (params.trajectory.experiments, lambda name: {
            part: tensor.numpy() for part, tensor in TRAJECTORY.read(traced, experiment=name).items()}),
        "explorer": (params.explorer.experiments, lambda name: {
            part: table.read_text(experiment=name) for part, (table, _) in single_insertions.TABLES.items()}),
    }  # fmt: skip
    return {name: Analysis(experiments[listed[0]], reader(listed[0]))
            for name, (listed, reader) in readers.items() if listed}  # fmt: skip


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
