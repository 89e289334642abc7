"""Everything that a report is made of, read from the pipeline's tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from isi.analyses import single_insertions
from isi.analyses.trajectory import TRACED
from isi.experiment.insert import among
from isi.graph.graph import MinedSource
from isi.params import ExperimentOf, Params
from isi.report import stated, varied
from isi.report.models import JOINT
from isi.report.statistics import converged
from isi.report.varied import Explored, Varied
from isi.sources._rows import read_rows
from isi.tables import catalogue, io, paths


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
        return [name for name in self.initializers if name not in self.how.at_once]

    @cached_property
    def at_once(self) -> pd.DataFrame:
        """Runs before any further training."""
        return self.runs[self.runs["epoch"] == 0]

    @property
    def curve_size(self) -> int | None:
        """The first size that is followed to the end and was run: the one whose curves are drawn."""
        return next((size for size in self.how.followed.sizes if size in self.how.sessions.sizes), None)

    @property
    def curves(self) -> pd.DataFrame:
        """Runs of that size by those who are followed, and of the joint model."""
        followed = [name for name in self.finetuned if among(self.how.followed.initializers, name)]
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
        mined={name: io.read_text(paths.mined(name), catalogue.MINED) for name in sources},
        asking={name: _asked(name) for name in params.asking.experiments},
        beyond=varied.read(experiments),
        explored=varied.explored(),
        nothing={name: io.read_text(paths.nothing(name), catalogue.RUNS) for name in params.nothing.experiments},
        **_studies(params, experiments),
    )


def _studies(params: Params, experiments: Mapping[str, Experiment]) -> dict[str, Study[Any]]:
    """The studies that were run, by the names that ``Results`` has for them."""
    asked: dict[str, tuple[list[str], Callable[[str], Any]]] = {
        "affordances": (params.affordances.experiments, _affordances),
        "sweep": (params.sweep.experiments, partial(_sweep, params.sweep.initializers)),
        "rates": (params.rates.experiments, partial(_rates, params)),
        "cross_validation": (params.cross_validation.experiments, _cross_validation),
        "families": (params.compare_families.experiments, partial(_families, params.compare_families.families)),
        "approach": (params.approach.experiments, _approach),
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
        entities=io.read_text(paths.entities(name), catalogue.ENTITIES),
        triples=io.read_text(paths.triples(name), catalogue.TRIPLES),
        coverage=io.read_text(paths.coverage(name), catalogue.COVERAGE),
        splits=io.read_text(paths.splits(name), catalogue.SPLITS),
        novel=io.read_text(paths.novel(name), catalogue.NOVEL),
        insert_triples=io.read_text(paths.insert_triples(name), catalogue.INSERT_TRIPLES),
        theta0_log=io.read_text(paths.training_log(name, "theta0"), catalogue.TRAINING_LOG),
        joint_log=io.read_text(paths.training_log(name, JOINT), catalogue.TRAINING_LOG),
        runs=_of_each(partial(paths.runs, name), catalogue.RUNS, [*initializers, JOINT]),
        inserted=_of_each(partial(paths.inserted, name), catalogue.INSERTED, initializers),
        ties=_of_each(partial(paths.ties, name), catalogue.TIES, [*initializers, JOINT]),
    )


def _seen(source: str) -> MinedSource:
    return MinedSource(
        source,
        io.read_text(paths.observations(source), catalogue.OBSERVATIONS),
        io.read_text(paths.kinds(source), catalogue.KINDS),
    )


def _affordances(experiment: str) -> pd.DataFrame:
    return io.read_text(paths.affordances(experiment), catalogue.AFFORDANCES).rename(columns={"initializer": "model"})


def _asked(experiment: str) -> Asked:
    return Asked(
        io.read_text(paths.asked(experiment), catalogue.ASKED), io.read_text(paths.used(experiment), catalogue.USED)
    )


def _sweep(initializers: Iterable[str], experiment: str) -> pd.DataFrame:
    return _of_each(partial(paths.indicator_sweep, experiment), catalogue.INDICATOR_SWEEP, initializers)


def _rates(params: Params, experiment: str) -> pd.DataFrame:
    return _of_each(partial(paths.rate_sweep, experiment), catalogue.RATE_SWEEP, params.rates.initializers)


def _cross_validation(experiment: str) -> pd.DataFrame:
    return io.read_text(paths.cross_validation(experiment), catalogue.CROSS_VALIDATION)


def _families(families: Iterable[str], experiment: str) -> pd.DataFrame:
    return _of_each(partial(paths.families, experiment), catalogue.FAMILIES, families, column="family")


def _of_each(
    path: Callable[[str], Path], schema: pa.Schema, names: Iterable[str], column: str = "model"
) -> pd.DataFrame:
    return pd.concat(io.read_text(path(name), schema).assign(**{column: name}) for name in names)


def _approach(experiment: str) -> Mapping[str, np.ndarray]:
    of_each = [f"{model}.{what}" for model in TRACED for what in ("path", "indicators")]
    tensors = io.read_tensors(paths.approach(experiment), ["entity", "known", "theta0", *of_each])
    return {name: tensor.numpy() for name, tensor in tensors.items()}


def _explorer(experiment: str) -> Mapping[str, pd.DataFrame]:
    listed = single_insertions.TABLES.items()
    return {what: io.read_text(paths.explorer(experiment, what), schema) for what, (schema, _) in listed}


def read_definitions(path: Path) -> pd.DataFrame:
    """What phrases mean: columns phrase and definition."""
    columns = ["phrase", "definition"]
    return pd.DataFrame([row.values for row in read_rows(path, columns, others=True)], columns=columns)
