"""The pipeline's tables as the report reads them:
experiments, analyses of them, and variants beyond the paper.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd

from isi.analyses.finetuning import FINETUNE_ONLY, INDICATOR_SWEEP, RATE_SWEEP
from isi.analyses.joint_models import CROSS_VALIDATION, MODEL_COMPARISON
from isi.analyses.query_breakdown import AFFORDANCES, QUERY_BREAKDOWN, USED_COORDINATES
from isi.analyses.trajectory import TRAJECTORY, traced
from isi.analyses.variants import GRAPH_QUERIES, GRAPH_RUNS, VARIANT_QUERIES, VARIANT_RUNS, Variant
from isi.evaluation.query_sets import epochs_to_convergence
from isi.experiment.insert import is_listed
from isi.experiment.store import INSERTED, RUNS, TIES, TRAINING_LOG
from isi.graph.graph import ENTITIES, GRAPH_ENTITIES, GRAPH_TRIPLES, TRIPLES, MinedSource
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import COVERAGE
from isi.params import ExperimentOf, Params, load_beyond
from isi.report import explorer, paper_values, stats
from isi.report.stats import DIRECTIONS, ByScope, Estimates, Values, where
from isi.report.words import BASELINE, JOINT
from isi.sources import KINDS, MINED, OBSERVATIONS
from isi.sources.readers import read_batches
from isi.tables import paths
from isi.tables.table import Table

if TYPE_CHECKING:  # no other page depends on them
    from isi.report.continual import ContinualRuns
    from isi.report.readings import CaseRuns

#: Analyses shown for every experiment that params list for them; the others are shown for the first
#: one alone.
_OF_EACH = ("query_breakdown", "finetune_only")
#: Fields of ``Experiment`` that are a whole table.
_OF_EXPERIMENT = {
    "entities": ENTITIES,
    "triples": TRIPLES,
    "coverage": COVERAGE,
    "splits": SPLITS,
    "novel": NOVEL,
    "insert_triples": INSERT_TRIPLES,
}


@dataclass(frozen=True, eq=False)
class ModelRuns:
    """Runs of initializers and of the joint model under the same conditions,
    on one experiment or graph.
    """

    #: its key in params
    name: str
    title: str
    params: Params
    initializers: list[str]
    #: rows of every initializer and of the joint model, named in the column ``model``
    runs: pd.DataFrame
    #: ``QUERY_BREAKDOWN``; None where it was not run
    queries: pd.DataFrame | None

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    @property
    def finetuned(self) -> list[str]:
        """All initializers; of an ``Experiment``, those whose entities are
        fine-tuned after insertion.
        """
        return self.initializers

    @property
    def max_epochs(self) -> int:
        """Maximum number of epochs of fine-tuning."""
        return self.params.finetuning.max_epochs

    def of_size(self, size: int | None) -> Self:
        """A copy with only the runs and queries that insert ``size`` entities
        (None: no runs and no queries).
        """
        queries = None if self.queries is None else where(self.queries, size=size)
        return replace(self, runs=where(self.runs, size=size), queries=queries)

    @cached_property
    def immediate(self) -> pd.DataFrame:
        """Runs right after insertion, before any further training."""
        return where(self.runs, epoch=0)

    def converged(self, runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
        """``epochs_to_convergence`` of runs, session by session,
        against the joint models of the same session.
        """
        joint, sessions = where(self.runs, model=JOINT), []
        for session in sorted(set(runs["session"])) or [1]:
            rows, target = (where(frame, session=session) for frame in (runs, joint))
            epochs = epochs_to_convergence(
                rows, target, self.params.convergence.margin, self.max_epochs, by
            )
            sessions.append(epochs.assign(session=session))
        return pd.concat(sessions, ignore_index=True)

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """``converged`` for the fine-tuned initializers:
        rows by model, scope, size, seed and session.
        """
        return self.converged(self.runs[self.runs["model"].isin(self.finetuned)], ["model"])

    @property
    def mrr_star(self) -> ByScope:
        """Mean MRR* right after insertion, in points, by scope and model,
        where there are queries.
        """
        return stats.by_scope(
            100 * self.immediate.groupby(["scope", "model"])["mrr_star"].mean().dropna(),
            self.models,
        )

    def epochs(self) -> ByScope:
        """Mean epochs to convergence, by scope and model."""
        means = self.convergence.groupby(["scope", "model"])["epochs"].mean()
        return stats.by_scope(means, self.finetuned)

    def fewer_epochs(self, scope: str) -> Values:
        """Per cent by which each initializer's mean epochs to convergence are below Xavier's
        (section 6.2); empty if Xavier was not run, or needs none.
        """
        epochs = self.epochs().get(scope, {})
        base = epochs.get(BASELINE)
        return {model: 100 * (1 - mean / base) for model, mean in epochs.items()} if base else {}

    @property
    def unconverged(self) -> ByScope:
        """The share of runs that never converge, in per cent, by scope and model."""
        converged = self.convergence.groupby(["scope", "model"])["converged"].mean()
        return stats.by_scope(100 * (1 - converged), self.finetuned)

    @cached_property
    def directed(self) -> pd.DataFrame:
        """Entity MRR* in [0, 1] in scope ``novel`` by direction (in column ``scope``), model,
        size and seed.
        """
        assert self.queries is not None  # noqa: S101  # used only with a query breakdown
        novel = list(DIRECTIONS)
        rows = where(
            self.queries, scope="novel", filter="learned", hidden=["head", "tail"], novel=novel
        )
        rows = rows.drop(columns="scope").rename(columns={"novel": "scope"})
        measures = stats.combined(rows, ["scope", "model", "size", "seed"])
        return measures.drop(columns=["mrr_star", "mrr_star_relation"])

    @cached_property
    def directions(self) -> dict[str, Estimates]:
        """Entity MRR* about novel entities by direction and model:
        means over sizes and seeds, in points.
        """
        rows = self.directed
        return {
            name: stats.by_model(where(rows, scope=name), "mrr_star_entity", self.models)
            for name in DIRECTIONS
        }

    def by_grid_point(self, scope: str, measure: str = "mrr_star") -> pd.DataFrame:
        """A measure (points) right after insertion:
        a row for each session, size and seed, a column for each model.

        In scope ``given``: entity MRR* over the queries that give a novel entity.
        """
        if scope == "given":
            rows, measure = self.directed.assign(session=1), "mrr_star_entity"
        else:
            rows = self.immediate
        return 100 * stats.cells_of(rows, self.models, scope, measure)

    @property
    def given_means(self) -> Estimates:
        """Entity MRR* (points) over queries that give the novel entity, by model."""
        return self.directions["given"]

    def immediate_means(self, scope: str) -> Estimates:
        """Mean MRR* (points) right after insertion in one scope, by model."""
        return stats.by_model(where(self.immediate, scope=scope), "mrr_star", self.models)

    def epochs_means(self) -> Estimates:
        """Mean epochs to convergence on held-out triples of the novel entities, by initializer."""
        heldout = where(self.convergence, scope="novel_heldout")
        return stats.by_model(heldout, "epochs", self.initializers, scale=1)


@dataclass(frozen=True, eq=False)
class Experiment(ModelRuns):
    """The tables of one experiment, with strings in place of categories (``read_text``);
    ids stay numbers.
    """

    #: end of the names of its tables and figures; empty for the first experiment
    suffix: str
    entities: pd.DataFrame
    triples: pd.DataFrame
    coverage: pd.DataFrame
    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame
    theta0_log: pd.DataFrame
    joint_log: pd.DataFrame
    inserted: pd.DataFrame
    ties: pd.DataFrame
    #: results of the analyses that were run, by section of params; for ``query_breakdown``:
    #: ``USED_COORDINATES``
    analyses: Mapping[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> ExperimentOf:
        """The entry of the experiment in params."""
        return self.params.experiments[self.name]

    @property
    def finetuned(self) -> list[str]:
        return [name for name in self.initializers if name not in self.settings.immediate_only]

    @property
    def curve_size(self) -> int | None:
        """The first size of ``full_curves`` that was run; None if none was."""
        settings = self.settings
        return next(
            (size for size in settings.full_curves.sizes if size in settings.sessions.sizes), None
        )

    @property
    def curves(self) -> pd.DataFrame:
        """Runs at ``curve_size`` of the initializers with full curves, and of the joint model;
        empty without any.
        """
        names = [
            name
            for name in self.finetuned
            if is_listed(self.settings.full_curves.initializers, name)
        ]
        rows = self.runs[
            (self.runs["size"] == self.curve_size) & self.runs["model"].isin([*names, JOINT])
        ]
        return rows if names else rows.head(0)

    @property
    def collapsed(self) -> Values:
        """Models that score many candidates like the answer,
        each with its mean number of tied competitors.

        A triple of scope ``all`` counts the competitors tied with the answer of its head, its tail
        and its relation query; the mean is over triples. A model is listed if its mean is at least
        |E| / 2.
        """
        tied, runs = (
            where(rows, scope="all").groupby("model") for rows in (self.ties, self.immediate)
        )
        competitors = tied["ties"].sum() / runs["queries"].sum().replace(0, np.nan)
        return {
            str(model): float(number)
            for model, number in competitors.items()
            if number >= len(self.entities) / 2
        }


@dataclass(frozen=True, eq=False)
class VariantRuns(ModelRuns):
    """The runs of a variant on one experiment, or on a graph of the second pipeline."""

    variant: Variant
    #: end of the names of its tables and figures
    id: str
    #: ``ENTITIES`` and ``TRIPLES`` of a graph of the second pipeline; empty for a variant
    entities: pd.DataFrame = field(default_factory=pd.DataFrame)
    triples: pd.DataFrame = field(default_factory=pd.DataFrame)

    @property
    def max_epochs(self) -> int:
        return int(
            self.variant.changes.get("finetuning.max_epochs", self.params.finetuning.max_epochs)
        )

    @classmethod
    def of(
        cls,
        key: str,
        variant: Variant,
        name: str,
        title: str,
        params: Params,
        runs: pd.DataFrame,
        queries: pd.DataFrame,
        *graph: pd.DataFrame,
    ) -> Self:
        """The rows of the experiment or graph ``name`` in a variant's tables;
        ``key``: the variant's key in params.
        """
        runs, queries = (where(rows, experiment=name) for rows in (runs, queries))
        initializers = [model for model in variant.initializers if model in set(runs["model"])]
        return cls(
            name, title, params, initializers, runs, queries, variant, f"{key}_{name}", *graph
        )


@dataclass(frozen=True, eq=False)
class Results:
    """Experiments with their analyses, and the variants and graphs of the
    second pipeline that were run.
    """

    params: Params
    #: params and versions, by title
    run: Mapping[str, Mapping[str, Any]]
    paper: Mapping[str, Any]
    vocabulary: Mapping[str, Any] = field(default_factory=dict)
    definitions: pd.DataFrame = field(default_factory=pd.DataFrame)
    experiments: Mapping[str, Experiment] = field(default_factory=dict)
    #: observations of each source, and its counts after each step of mining (``MINED``)
    observed: Mapping[str, MinedSource] = field(default_factory=dict)
    mined: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    variants: Sequence[VariantRuns] = ()
    other_graphs: Sequence[VariantRuns] = ()
    #: cases measured under every reading of the paper's metric that were run, by name
    readings: Mapping[str, "CaseRuns"] = field(default_factory=dict)
    #: experiments of the third pipeline that were run
    continual: Sequence["ContinualRuns"] = ()

    @property
    def standalone(self) -> list[Experiment]:
        """Experiments whose entities all come from one source."""
        return [each for each in self.experiments.values() if not each.settings.graph.extend]

    @property
    def extended(self) -> list[Experiment]:
        """Experiments that insert entities of a second source (``graph.extend``)."""
        return [each for each in self.experiments.values() if each.settings.graph.extend]

    def source_title(self, source: str) -> str:
        """The title of a source: that of the experiment on its graph, else its name."""
        titles = {each.settings.graph.source: each.title for each in reversed(self.standalone)}
        return titles.get(source, source)

    def analysis(self, name: str, *among: Experiment | None) -> list[tuple[Experiment, Any]]:
        """The experiments (without ``among``: of all) for which an analysis was run,
        each with its tables.
        """
        ran = (
            each for each in among or self.experiments.values() if each and name in each.analyses
        )
        return [(experiment, experiment.analyses[name]) for experiment in ran]

    def variants_of(self, group: str) -> list[VariantRuns]:
        """The variants of one group."""
        return [runs for runs in self.variants if runs.variant.group == group]


def read(params: Params, run: Mapping[str, Mapping[str, Any]]) -> Results:
    """Read the tables of all experiments and analyses;
    ``InputError`` where one is missing or broken.
    """
    experiments = {name: _experiment(params, name) for name in params.experiments}
    graphs = [entry.graph for entry in params.experiments.values()]
    sources = dict.fromkeys(
        part.source for graph in graphs for part in (graph, graph.extend) if part
    )
    return Results(
        params=params,
        run=run,
        paper=paper_values.read(paths.PAPER),
        experiments=experiments,
        vocabulary=paper_values.read(
            paths.PAPER.with_name("vocabulary.yaml"), paper_values.VOCABULARY
        ),
        definitions=read_definitions(paths.DEFINITIONS),
        observed={
            name: MinedSource(
                name, OBSERVATIONS.read_text(source=name), KINDS.read_text(source=name)
            )
            for name in sources
        },
        mined={name: MINED.read_text(source=name) for name in sources},
    )


def with_beyond(results: Results) -> Results:
    """Results with the runs of the second pipeline, of which any may be missing."""
    tables, params = (GRAPH_RUNS, GRAPH_QUERIES, GRAPH_ENTITIES, GRAPH_TRIPLES), results.params
    graphs = [
        VariantRuns.of(
            name,
            graph.variant(name),
            name,
            graph.title,
            params,
            *(table.read_text(graph=name) for table in tables),
        )
        for name, graph in load_beyond(params, runs=False).graphs.items()
        if GRAPH_QUERIES.path(graph=name).exists()
    ]
    titles = {name: experiment.title for name, experiment in results.experiments.items()}
    return replace(results, variants=read_variants(titles, params), other_graphs=graphs)


def read_variants(titles: Mapping[str, str], params: Params) -> list[VariantRuns]:
    """Runs of every variant on every experiment where it was run;
    ``titles``: display titles by experiment.
    """
    variants = []
    for name, variant in load_beyond(params, runs=False).variants.items():
        if VARIANT_QUERIES.path(variant=name).exists():
            tables = [table.read_text(variant=name) for table in (VARIANT_RUNS, VARIANT_QUERIES)]
            ran = titles.keys() & set(tables[0]["experiment"])
            variants += [
                VariantRuns.of(name, variant, experiment, titles[experiment], params, *tables)
                for experiment in variant.experiments
                if experiment in ran
            ]
    return variants


def _experiment(params: Params, name: str) -> Experiment:
    initializers, table = params.initializers_of(name), partial(_table, name)
    models, of_initializer = [*initializers, JOINT], partial(table, slot="initializer")
    parts = ["entity", "known", "theta0"]
    for model in traced(params.initializers):
        parts += [f"{model}.path", f"{model}.indicators"]
    readers: dict[str, Callable[[], Any]] = {
        "affordances": lambda: table(AFFORDANCES).rename(columns={"initializer": "model"}),
        "sweep": lambda: of_initializer(INDICATOR_SWEEP, params.sweep.initializers),
        "rate_sweep": lambda: of_initializer(RATE_SWEEP, params.rate_sweep.initializers),
        "cross_validation": lambda: table(CROSS_VALIDATION),
        "compare_models": lambda: table(MODEL_COMPARISON, params.compare_models.models),
        "trajectory": lambda: {
            part: tensor.numpy() for part, tensor in TRAJECTORY.read(parts, experiment=name).items()
        },
        "explorer": lambda: explorer.read(params, name),
        "query_breakdown": lambda: table(USED_COORDINATES),
        "finetune_only": lambda: table(FINETUNE_ONLY),
    }
    ran = list[str]()
    for section in readers:
        names = params.studies[section].experiments
        if name in (names if section in _OF_EACH else names[:1]):
            ran.append(section)
    return Experiment(
        name=name,
        title=params.experiments[name].title,
        params=params,
        initializers=initializers,
        suffix="" if name == next(iter(params.experiments)) else f"_{name}",
        runs=table(RUNS, models),
        ties=table(TIES, models),
        inserted=of_initializer(INSERTED, initializers),
        queries=table(QUERY_BREAKDOWN) if "query_breakdown" in ran else None,
        theta0_log=table(TRAINING_LOG, ["theta0"]),
        joint_log=table(TRAINING_LOG, [JOINT]),
        analyses={section: readers[section]() for section in ran},
        **{field: table(of_experiment) for field, of_experiment in _OF_EXPERIMENT.items()},
    )


def _table(
    experiment: str,
    table: Table,
    names: Iterable[str] = (),
    slot: str = "model",
) -> pd.DataFrame:
    """One file of a table, or those of ``names`` (in ``slot`` of the path) concatenated;
    the column ``model`` has the name.
    """
    parts = [
        table.read_text(experiment=experiment, **{slot: name}).assign(model=name) for name in names
    ]
    return pd.concat(parts) if parts else table.read_text(experiment=experiment)


def read_definitions(path: Path) -> pd.DataFrame:
    """Definitions of phrases; columns ``phrase`` and ``definition``."""
    columns = ["phrase", "definition"]
    parts = read_batches(path, columns, others=True)
    return pd.concat([pd.DataFrame(columns=columns, dtype=str), *parts], ignore_index=True)
