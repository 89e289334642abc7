"""What the tables are made from: the pipeline's outputs, read as they are needed.

One frame has the runs of an experiment, of a variant or of another graph: columns model, size,
seed, epoch, scope, the measures in [0, 1] and the number of queries.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import pandas as pd

from isi import config
from isi.evaluation.query_sets import epochs_to_convergence
from isi.initializers.api import INITIALIZERS
from isi.tables.table import Table
from stages.breakdown import QUERY_BREAKDOWN
from stages.check_params import ExperimentOf, Params
from stages.cross_validate import CROSS_VALIDATION
from stages.files import ENTITIES, PAPER, TRIPLES
from stages.finetune_only import FINETUNE_ONLY
from stages.grid import JOINT_MODEL, is_listed
from stages.rank_affordances import AFFORDANCES
from stages.report.scopes import DIRECTIONS
from stages.report.tables.estimates import (
    CELL,
    cells_of,
    combined,
    difference,
    over_seeds,
    under,
    where,
)
from stages.report.tables.statistics import Statistics
from stages.store import MEASURE_CHANGES, RUNS
from stages.sweep_indicators import INDICATOR_SWEEP

#: Name of Θ⁰ that is fine-tuned without insertion, in place of an initializer's.
NOT_INSERTED = "finetune_only"
#: The source whose graph is the paper's own.
PAPERS_SOURCE = "published"


@dataclass(frozen=True, eq=False)
class ModelLabels:
    """Labels and roles of initializers and of the other models, by name."""

    labels: Mapping[str, str]
    roles: Mapping[str, str]

    @classmethod
    def registered(cls) -> Self:
        """Those of all registered initializers."""
        initializers = {name: INITIALIZERS.get(name) for name in INITIALIZERS.names()}
        labels = {JOINT_MODEL: "Joint", NOT_INSERTED: "Nothing inserted"}
        labels |= {name: each.label for name, each in initializers.items()}
        return cls(labels, {name: each.role for name, each in initializers.items()})

    def of_role(self, models: Iterable[str], *roles: str) -> list[str]:
        """The models among some with one of the roles, in order."""
        return [name for name in models if self.roles.get(name) in roles]

    def labelled(self, frame: pd.DataFrame, *columns: str) -> pd.DataFrame:
        """The frame with labels in place of names in some columns."""
        shown = {name: frame[name].astype(object).replace(self.labels) for name in columns}
        return frame.assign(**shown)

    def in_rows(
        self,
        means: pd.DataFrame,
        models: Sequence[str],
        header: str = "model",
        **orders: Sequence[str],
    ) -> pd.DataFrame:
        """Means by group (index levels) as rows of a table, in the order of the models and of
        ``orders``, by level.
        """
        orders = {"model": models, **orders}
        frame = where(means.reset_index(), **{name: list(order) for name, order in orders.items()})
        for name, order in orders.items():
            frame[name] = pd.Categorical(frame[name], list(order))
        frame = frame.sort_values(list(map(str, means.index.names)))
        frame = self.labelled(frame, "model")
        return frame.rename(columns={"model": header}).reset_index(drop=True)

    def by_label(
        self, models: Iterable[str], columns: Mapping[str, Any], header: str = "model"
    ) -> pd.DataFrame:
        """A row for each model: its label, then columns of values by model; a frame gives all its
        columns, under its name if this is not empty.
        """
        models = list(models)
        parts: list[Any] = [pd.Series(self.labels, name=header).reindex(models)]
        for name, values in columns.items():
            if isinstance(values, pd.DataFrame):
                parts.append(under(values.reindex(models), name))
            else:
                parts.append(pd.Series(values, dtype=float).reindex(models).rename(name))
        joined: pd.DataFrame = pd.concat(parts, axis=1).reset_index(drop=True)
        return joined


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of initializers and of the joint model on one graph, under the same conditions."""

    name: str
    title: str
    models: ModelLabels
    initializers: list[str]
    runs: pd.DataFrame
    queries: pd.DataFrame | None  #: the query breakdown; None where it was not run
    margin: float
    max_epochs: int
    finetuned: list[str] = field(default_factory=list)
    finetuned_seeds: int | None = None  #: of the seeds, the first so many; None: all

    def of_size(self, size: int | None) -> Self:
        """Only the runs and queries that insert ``size`` entities."""
        queries = None if self.queries is None else where(self.queries, size=size)
        return replace(self, runs=where(self.runs, size=size), queries=queries)

    @property
    def rows(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT_MODEL]

    @property
    def methods(self) -> list[str]:
        """The initializers that the paper proposes."""
        return self.models.of_role(self.initializers, "isi")

    @cached_property
    def immediate(self) -> pd.DataFrame:
        """Runs right after insertion, before any further training."""
        return where(self.runs, epoch=0)

    def converged(
        self,
        runs: pd.DataFrame,
        by: list[str],
        seeds: int | None = None,
        joint: pd.DataFrame | None = None,
    ) -> pd.DataFrame:
        """``epochs_to_convergence`` of runs, of the first ``seeds`` alone; ``joint``: the joint
        models' measures, if they are others.
        """
        target = where(self.runs, model=JOINT_MODEL) if joint is None else joint
        rows = runs if seeds is None else runs[runs["seed"] < seeds]
        return epochs_to_convergence(rows, target, self.margin, self.max_epochs, by)

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence: rows by model, size and seed."""
        runs = where(self.runs, model=self.finetuned)
        return self.converged(runs, ["model"], self.finetuned_seeds)

    def statistics(self, measure: str = "mrr") -> Statistics:
        """The paper's statistics of these runs, by a measure right after insertion."""
        now = self.immediate.assign(value=100 * self.immediate[measure])
        return Statistics(now[["model", "scope", *CELL, "value"]], self.convergence)

    @cached_property
    def directed(self) -> pd.DataFrame:
        """Entity MRR in [0, 1] about novel entities by direction (in column ``scope``), model, size
        and seed; empty without a query breakdown.
        """
        columns = ["scope", "model", *CELL, "mrr_entity"]
        if self.queries is None or self.queries.empty:
            return pd.DataFrame(columns=columns)
        rows = where(self.queries, scope="novel", hidden=["head", "tail"])
        rows = where(rows, novel=list(DIRECTIONS)).drop(columns="scope")
        rows = rows.rename(columns={"novel": "scope"})
        return combined(rows, ["scope", "model", *CELL])[columns]

    def means(self, scope: str, measure: str = "mrr") -> pd.DataFrame:
        """Mean (points) of a measure right after insertion, with its interval: rows by model,
        column ``mean``. Scope ``given``: entity MRR with the novel entity given.
        """
        rows, measure = self._measured(scope, measure)
        means = over_seeds(where(rows, scope=scope), ["model"], {measure: "mean"})
        return means.reindex(self.rows).dropna(subset="mean")

    def by_run(self, scope: str, measure: str = "mrr") -> pd.DataFrame:
        """Means of a measure in a scope, in points, by size and seed (rows) and model (columns)."""
        rows, measure = self._measured(scope, measure)
        return 100 * cells_of(rows, self.rows, scope, measure)

    def _measured(self, scope: str, measure: str) -> tuple[pd.DataFrame, str]:
        if scope in DIRECTIONS:
            return self.directed, "mrr_entity"
        return self.immediate, measure

    def minus(self, scope: str, first: str, second: str) -> dict[str, float]:
        """MRR (points) of ``first`` minus that of ``second``, right after insertion."""
        cells = self.by_run(scope)
        return difference(cells[first], cells[second])


@dataclass(frozen=True, eq=False)
class Experiment(Runs):
    """The runs of one experiment of params, with its other tables."""

    params: Params | Any = None

    @classmethod
    def read(cls, params: Params, models: ModelLabels, name: str) -> Self:
        """The tables of an experiment; ``InputError`` where one is missing or broken."""
        of_experiment, initializers = params.of(name), params.initializers_of(name)
        settings = params.experiments[name]
        finetuned = settings.finetuned.initializers
        rows = [*initializers, JOINT_MODEL]
        return cls(
            name=name,
            title=settings.title,
            models=models,
            initializers=initializers,
            runs=of_models(RUNS, rows, experiment=name),
            queries=of_models(QUERY_BREAKDOWN, rows, experiment=name),
            margin=of_experiment.convergence.margin,
            max_epochs=of_experiment.finetuning.max_epochs,
            finetuned=[each for each in initializers if is_listed(finetuned, each)],
            finetuned_seeds=settings.finetuned.seeds,
            params=params,
        )

    @property
    def settings(self) -> ExperimentOf:
        """The entry of the experiment in params."""
        settings: ExperimentOf = self.params.experiments[self.name]
        return settings

    def is_in(self, section: str) -> bool:
        """Whether a study of params lists the experiment."""
        return self.name in self.params.studies[section].experiments

    @cached_property
    def changes(self) -> pd.DataFrame | None:
        """The measure with one part changed at a time; None where it was not run."""
        if not self.is_in("measure_changes"):
            return None
        return of_models(MEASURE_CHANGES, self.rows, experiment=self.name)

    @cached_property
    def sweep(self) -> pd.DataFrame | None:
        """The runs of the sweep of indicator set sizes, with a column k; None where it was not
        run.
        """
        if not self.is_in("sweep"):
            return None
        initializers = list(self.params.sweep.initializers)
        return of_models(INDICATOR_SWEEP, initializers, "initializer", experiment=self.name)

    @cached_property
    def finetuned_alone(self) -> pd.DataFrame | None:
        """Runs of Θ⁰ that is fine-tuned without insertion; None where it was not run."""
        if not self.is_in("finetune_only"):
            return None
        return FINETUNE_ONLY.read_text(experiment=self.name)

    @cached_property
    def affordances(self) -> pd.DataFrame | None:
        """Ranks of the answers about inserted entities; None where they were not ranked."""
        return AFFORDANCES.read_text(experiment=self.name) if self.is_in("affordances") else None

    @cached_property
    def folds(self) -> pd.DataFrame | None:
        """The measures of each setting by fold; None where cross-validation was not run."""
        if not self.is_in("cross_validation"):
            return None
        return CROSS_VALIDATION.read_text(experiment=self.name)

    @cached_property
    def entities(self) -> pd.DataFrame:
        """The entities; row numbers are ids."""
        return ENTITIES.read_text(experiment=self.name)

    @cached_property
    def triples(self) -> pd.DataFrame:
        """The unique triples with their counts."""
        return TRIPLES.read_text(experiment=self.name)

    @property
    def curve_size(self) -> int | None:
        """The first size that is fine-tuned for all epochs; None if none is."""
        return next(iter(self.settings.full_curves), None)

    @cached_property
    def curves(self) -> pd.DataFrame:
        """Runs at ``curve_size`` that are fine-tuned, of the joint model at the same seeds, and of
        Θ⁰ that is fine-tuned without insertion; empty without any.
        """
        rows = where(self.runs, size=self.curve_size, model=[*self.finetuned, JOINT_MODEL])
        if self.finetuned_seeds is not None:
            rows = rows[rows["seed"] < self.finetuned_seeds]
        if not self.finetuned or rows.empty:
            return rows.head(0)
        if self.finetuned_alone is None:
            return rows
        alone = where(self.finetuned_alone, size=self.curve_size, scope="known_closed")
        return pd.concat([rows, alone.assign(model=NOT_INSERTED)], ignore_index=True)


def of_models(
    table: Table, models: Sequence[str], argument: str = "model", **names: str
) -> pd.DataFrame:
    """The files of a table of some models below each other; the column ``model`` has the name.
    ``argument``: that of the model in the path of the table.
    """
    parts = list[pd.DataFrame]()
    for model in models:
        rows = table.read_text(**names, **{argument: model})
        parts.append(rows.assign(model=model))
    return pd.concat(parts)


@dataclass(frozen=True, eq=False)
class Results:
    """All experiments of params, with the paper's numbers."""

    params: Params
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any]
    models: ModelLabels
    experiments: list[Experiment]

    @classmethod
    def read(cls, params: Params) -> Self:
        """Read what all tables need; the rest is read when it is needed."""
        models = ModelLabels.registered()
        experiments = [Experiment.read(params, models, name) for name in params.experiments]
        paper = config.read(PAPER)
        vocabulary = config.read(PAPER.with_name("vocabulary.yaml"))
        return cls(params, paper, vocabulary, models, experiments)

    @property
    def standalone(self) -> list[Experiment]:
        """Experiments whose entities all come from one source."""
        return [each for each in self.experiments if not each.settings.graph.extend]

    @property
    def extended(self) -> list[Experiment]:
        """Experiments that insert entities of a second source (``graph.extend``)."""
        return [each for each in self.experiments if each.settings.graph.extend]

    def on(self, papers: bool, extended: bool = False) -> Experiment | None:
        """The first experiment on the paper's own graph, or on another one; ``extended``: that
        inserts entities of a second source.
        """
        for experiment in self.extended if extended else self.standalone:
            if (experiment.settings.graph.source == PAPERS_SOURCE) == papers:
                return experiment
        return None

    def transfer_of(self, experiment: Experiment) -> Experiment | None:
        """The first experiment that extends the graph of another one."""
        source = experiment.settings.graph.source
        return next((each for each in self.extended if each.settings.graph.source == source), None)
