"""What the tables are made from: the pipeline's outputs, read as they are needed.

One frame has the runs of an experiment, of a variant or of another graph: columns model, size,
seed, epoch, scope, the measures in [0, 1] and the number of queries.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import pandas as pd

from isi import config
from isi.evaluation.query_sets import epochs_to_convergence
from isi.evaluation.scopes import SCOPES
from isi.tables import paths
from isi.tables.io import opening
from isi.tables.table import as_text
from stages.report.tables.estimates import (
    CELL,
    Names,
    cells_of,
    combined,
    difference,
    over_seeds,
    where,
)
from stages.report.tables.statistics import Statistics

if TYPE_CHECKING:
    from stages.check_params import ExperimentOf, Params

JOINT = "joint"
#: The model without insertion: Θ⁰, fine-tuned.
FINETUNE_ONLY = "finetune_only"
#: Role of the novel entity in a query of scope ``novel``, with its title.
DIRECTIONS = {"given": "novel entity given", "answer": "novel entity is the answer"}
#: Titles of all that is measured right after insertion.
TITLES = {**SCOPES, **DIRECTIONS}
#: The source whose graph is the paper's own.
PAPERS_SOURCE = "published"


def read(path: str | Path) -> pd.DataFrame:
    """A Parquet table with plain strings; ``InputError`` if it is missing or broken."""
    with opening(Path(path), "a Parquet table", ValueError):
        frame = pd.read_parquet(path)
    return as_text(frame)


@dataclass(frozen=True, eq=False)
class Models:
    """Labels and roles of initializers and of the other models, by name."""

    labels: Mapping[str, str]
    roles: Mapping[str, str]

    @classmethod
    def of(cls, registered: pd.DataFrame) -> Self:
        """From a table with columns name, label and role."""
        rows = registered.set_index("name").astype(str)
        others = {JOINT: "Joint", FINETUNE_ONLY: "Nothing inserted"}
        return cls(others | dict(rows["label"]), dict(rows["role"]))

    @classmethod
    def read(cls, path: Path) -> Self:
        """From the file of the pipeline."""
        with opening(path, "a table of initializers", ValueError):
            return cls.of(pd.read_csv(path))

    def of_role(self, models: Iterable[str], *roles: str) -> list[str]:
        """The models among some with one of the roles, in order."""
        return [name for name in models if self.roles.get(name) in roles]

    def labelled(self, frame: pd.DataFrame, *columns: str) -> pd.DataFrame:
        """The frame with labels in place of names in some columns."""
        shown = {name: frame[name].astype(object).replace(self.labels) for name in columns}
        return frame.assign(**shown)


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of initializers and of the joint model on one graph, under the same conditions."""

    name: str
    title: str
    models: Models
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
        return [*self.initializers, JOINT]

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
        target = where(self.runs, model=JOINT) if joint is None else joint
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
        """The same by size and seed (rows) and model (columns)."""
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

    params: "Params | Any" = None

    @classmethod
    def read(cls, params: "Params", models: Models, name: str) -> Self:
        """The tables of an experiment; ``InputError`` where one is missing or broken."""
        of_experiment, initializers = params.of(name), params.initializers_of(name)
        settings = params.experiments[name]
        listed = settings.finetuned.initializers
        breakdown = f"data/analyses/query_breakdown/{name}/{{}}.parquet"
        return cls(
            name=name,
            title=settings.title,
            models=models,
            initializers=initializers,
            runs=of_models(f"data/runs/{name}/{{}}.parquet", [*initializers, JOINT]),
            queries=of_models(breakdown, [*initializers, JOINT]),
            margin=of_experiment.convergence.margin,
            max_epochs=of_experiment.finetuning.max_epochs,
            finetuned=[each for each in initializers if listed == "all" or each in listed],
            finetuned_seeds=settings.finetuned.seeds,
            params=params,
        )

    @property
    def settings(self) -> "ExperimentOf":
        """The entry of the experiment in params."""
        settings: ExperimentOf = self.params.experiments[self.name]
        return settings

    def table(self, place: str) -> pd.DataFrame:
        """A table of the experiment; ``{}`` in its place stands for the name."""
        return read(place.format(self.name))

    def analysis(self, section: str) -> pd.DataFrame | None:
        """The results of an analysis of one file; None where it was not run for this experiment."""
        study = self.params.studies[section]
        if self.name not in study.experiments:
            return None
        return read(f"data/analyses/{section}/{self.name}.parquet")

    def swept(self, section: str, folder: str, names: Names) -> pd.DataFrame | None:
        """The same for an analysis with a file for each initializer."""
        if self.name not in self.params.studies[section].experiments:
            return None
        return of_models(f"data/analyses/{folder}/{self.name}/{{}}.parquet", names)

    @cached_property
    def changes(self) -> pd.DataFrame | None:
        """The measure with one part changed at a time; None where it was not run."""
        return self.swept("measure_changes", "measure", self.rows)

    @cached_property
    def entities(self) -> pd.DataFrame:
        """The entities; row numbers are ids."""
        return self.table("data/graph/{}/entities.parquet")

    @cached_property
    def triples(self) -> pd.DataFrame:
        """The unique triples with their counts."""
        return self.table("data/graph/{}/triples.parquet")

    @property
    def curve_size(self) -> int | None:
        """The first size that is fine-tuned for all epochs; None if none is."""
        return next(iter(self.settings.full_curves), None)

    @cached_property
    def curves(self) -> pd.DataFrame:
        """Runs at ``curve_size`` that are fine-tuned, of the joint model at the same seeds, and of
        Θ⁰ that is fine-tuned without insertion; empty without any.
        """
        rows = where(self.runs, size=self.curve_size, model=[*self.finetuned, JOINT])
        if self.finetuned_seeds is not None:
            rows = rows[rows["seed"] < self.finetuned_seeds]
        if not self.finetuned or rows.empty:
            return rows.head(0)
        alone = self.analysis("finetune_only")
        if alone is None:
            return rows
        alone = where(alone, size=self.curve_size, scope="known_closed")
        return pd.concat([rows, alone.assign(model=FINETUNE_ONLY)], ignore_index=True)


def of_models(place: str, names: Names) -> pd.DataFrame:
    """The files of some models below each other; the column ``model`` has the name."""
    return pd.concat([read(place.format(name)).assign(model=name) for name in names])


@dataclass(frozen=True, eq=False)
class Results:
    """All experiments of params, with the paper's numbers."""

    params: "Params"
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any]
    models: Models
    experiments: list[Experiment]

    @classmethod
    def read(cls, params: "Params") -> Self:
        """Read what all tables need; the rest is read when it is needed."""
        models = Models.read(paths.DATA / "analyses" / "initializers.csv")
        experiments = [Experiment.read(params, models, name) for name in params.experiments]
        paper = config.read(paths.PAPER)
        vocabulary = config.read(paths.PAPER.with_name("vocabulary.yaml"))
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
        listed = self.extended if extended else self.standalone
        of_graph = (
            each for each in listed if (each.settings.graph.source == PAPERS_SOURCE) == papers
        )
        return next(of_graph, None)

    def transfer_of(self, experiment: Experiment) -> Experiment | None:
        """The first experiment that extends the graph of another one."""
        source = experiment.settings.graph.source
        return next((each for each in self.extended if each.settings.graph.source == source), None)
