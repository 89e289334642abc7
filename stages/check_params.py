"""Check all params, for `make`: DVC reads only the keys that its stages name."""

import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import Field

from isi import config
from isi.config import Name, Section, Seed, Study, check_names, distinct
from isi.errors import InputError, at
from isi.initializers.api import options_of
from isi.models.model import EmbeddingParams, make_model
from isi.process import errors_in_one_line
from isi.sources import settings_of
from isi.sources.recordings import Recorder
from isi.tables import paths
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer, Training
from stages.build_graph import GraphOf
from stages.cross_validate import CrossValidation, Setting
from stages.embed_words import Words
from stages.explore import GraphExperiment
from stages.grid import Finetuned, FullCurves, InitializerList, NovelSet, is_listed
from stages.insert import Convergence
from stages.make_sessions import SessionsOf, Shares
from stages.params import CONDITIONS, StageParams
from stages.pipeline import BEYOND_PARAMS
from stages.rank_affordances import Affordances
from stages.runner import Compute
from stages.sweep_indicators import Sweep
from stages.trace_trajectory import Trajectories, traced
from stages.vary import Variant

S = TypeVar("S", bound=Section)

#: Maximum number of settings in cross-validation; a setting trains one model per fold.
MOST_SETTINGS = 13


def is_extended_if_added(entry: "ExperimentOf") -> bool:
    """Whether novel entities are those of an extension exactly if the graph has one."""
    return (entry.sessions.novel == "added") == (entry.graph.extend is not None)


def has_enough_candidates(entry: "ExperimentOf") -> bool:
    """Whether an extension has candidates for the largest novel set."""
    extend = entry.graph.extend
    return extend is None or max(entry.sessions.sizes) <= extend.candidates


def curves_are_of_its_sizes(entry: "ExperimentOf") -> bool:
    """Whether the sizes of the learning curves are among those of the sessions."""
    return set(entry.full_curves) <= set(entry.sessions.sizes)


class ExperimentOf(Section):
    """An entry under ``experiments``."""

    rules = (
        (
            is_extended_if_added,
            "expected sessions.novel: added with graph.extend, and another value without it",
        ),
        (has_enough_candidates, "sessions: expected max(sizes) ≤ graph.extend.candidates"),
        (curves_are_of_its_sizes, "full_curves: expected sizes among sessions.sizes"),
    )
    title: str
    graph: GraphOf
    sessions: SessionsOf
    initializers: InitializerList
    finetuned: Finetuned
    full_curves: FullCurves
    #: conditions that replace those of the general sections; None: none do
    negatives: dict[str, Any] | None
    training: dict[str, Any] | None
    finetuning: dict[str, Any] | None


class Plots(Section):
    """``plots`` in params: which curves ``dvc plots`` shows."""

    initializers: list[Name]


class Params(Section):
    """All sections of ``params.yaml``."""

    seed: Seed
    sources: dict[Name, dict[str, Any]]
    experiments: Annotated[dict[Name, ExperimentOf], Field(min_length=1)]
    sessions: Shares
    words: Words
    embedding: EmbeddingParams
    models: dict[Name, dict[str, Any]]
    negatives: Negatives
    training: Training
    finetuning: Optimizer
    convergence: Convergence
    initializers: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)]
    plots: Plots
    measure_changes: Study
    finetune_only: Study
    sweep: Sweep
    cross_validation: CrossValidation
    trajectory: Trajectories
    affordances: Affordances
    compute: Compute
    recorder: Recorder
    final_model: Study
    explorer: NovelSet

    @property
    def studies(self) -> dict[str, Study]:
        """The studies in addition to the main pipeline, by section of params."""
        return {name: section for name, section in self if isinstance(section, Study)}

    @property
    def settings(self) -> list[Setting]:
        """The settings that cross-validation compares;
        the first is the setting of all experiments.
        """
        rates = self.training.model_dump(include={"learning_rate", "weight_decay"})
        choice = Setting(dimension=self.embedding.dimension, ratio=self.negatives.ratio, **rates)
        return self.cross_validation.settings(choice)

    def of(self, experiment: str) -> Self:
        """These params with an experiment's own conditions in place of the general ones."""
        entry, sections = self.experiments[experiment], dict[str, Section]()
        for name in CONDITIONS:
            general: Section = getattr(self, name)
            values = {**general.model_dump(), **(getattr(entry, name) or {})}
            key = f"experiments.{experiment}.{name}"
            sections[name] = config.check(values, type(general), key, "")
        return self.model_copy(update=sections)

    def initializers_of(self, experiment: str) -> list[str]:
        """The initializers that an experiment runs, in the order of params."""
        names = self.experiments[experiment].initializers
        return [name for name in self.initializers if is_listed(names, name)]


class Beyond(Section):
    """All sections of ``beyond/params.yaml``."""

    graphs: dict[Name, GraphExperiment] = Field(default_factory=dict)
    variants: dict[Name, Variant] = Field(default_factory=dict)


def load(path: Path = paths.PARAMS) -> Params:
    """Read and check ``params.yaml``; InputError names the dotted key that is wrong."""
    return _load(path, Params, check_params)


def load_beyond(params: Params, path: Path = BEYOND_PARAMS, *, runs: bool = True) -> Beyond:
    """Read ``beyond/params.yaml`` (empty if it is missing), and check it alone and against
    ``params``.

    Without ``runs``, variants and graphs may name experiments and initializers that ``params``
    lack.
    """
    if not path.exists():
        return Beyond()
    return _load(path, Beyond, lambda beyond: check_beyond(beyond, params, runs))


def _load(path: Path, kind: type[S], agree: Callable[[S], None]) -> S:
    section = config.check(config.read(path), kind, "", path)
    with at(path):
        try:
            agree(section)
        except InputError as error:  # plug-ins name params.yaml, but the file may be another
            file = "" if error.file == str(paths.PARAMS) else error.file
            raise InputError(file, error.place, error.message) from error
    return section


def check_params(params: Params) -> None:
    """Check sections against each other and the plug-ins;
    InputError for an unknown name, size or option.
    """
    if "joint" in params.initializers:
        raise InputError(
            "", "initializers.joint", "expected another name: joint is the joint model"
        )
    for key, names, known in _listed_names(params):
        check_names(names, known, key)
    for name in params.experiments:
        params.of(name)
    for name, study in params.studies.items():
        _check_study(study, params, name)
    for name, settings in params.sources.items():
        settings_of(settings, f"sources.{name}")
    for name, options in params.initializers.items():
        options_of(name, options, f"initializers.{name}")
    if params.trajectory.experiments and not traced(params.initializers):
        expected = "expected no experiments, since initializers lists none whose path is shown"
        raise InputError("", "trajectory.experiments", expected)
    for name, options in params.sweep.initializers.items():
        options_of(name, {**options, "k": params.sweep.k[0]}, f"sweep.initializers.{name}")
    models = {
        name: make_model(name, options, f"models.{name}") for name, options in params.models.items()
    }
    used, tried = params.embedding, params.cross_validation
    for key, dimensions in (
        ("embedding.dimension", [used.dimension]),
        ("cross_validation.dimension", tried.dimension if tried.experiments else []),
    ):
        with at("", key):
            for dimension in dimensions:
                models[used.model].width(dimension)
    if len(params.settings) > MOST_SETTINGS:
        expected = f"expected at most {MOST_SETTINGS} settings, got {len(params.settings)}"
        raise InputError("", "cross_validation", expected)


def _listed_names(params: Params) -> Iterator[tuple[str, Iterable[str], Iterable[str]]]:
    """For each key that lists names: the key, the names listed, and the names that exist."""
    known, studies = params.initializers, params.studies
    yield "plots.initializers", params.plots.initializers, known
    yield "embedding.model", [params.embedding.model], params.models
    yield from (
        (f"{name}.experiments", study.experiments, params.experiments)
        for name, study in studies.items()
    )
    if params.sweep.experiments:
        yield "sweep.initializers", params.sweep.initializers, known
    for name, experiment in params.experiments.items():
        key, extend = f"experiments.{name}", experiment.graph.extend
        yield f"{key}.graph.source", [experiment.graph.source], params.sources
        yield f"{key}.graph.extend.source", [extend.source] if extend else [], params.sources
        lists = {
            "initializers": experiment.initializers,
            "finetuned.initializers": experiment.finetuned.initializers,
        }
        yield from (
            (f"{key}.{place}", [] if names == "all" else names, known)
            for place, names in lists.items()
        )


def _check_study(study: Study, params: Params, name: str) -> None:
    """InputError unless each experiment of a study has the sizes and seeds of the study."""
    last = "seeds" if hasattr(study, "seeds") else "seed"
    seeds = getattr(study, "seeds", getattr(study, "seed", -1) + 1)
    for experiment in study.experiments:
        sessions = params.experiments[experiment].sessions
        if getattr(study, "size", sessions.sizes[0]) not in sessions.sizes:
            raise InputError("", f"{name}.size", f"expected one of the sizes of {experiment}")
        if seeds > sessions.seeds:
            expected = (
                f"expected a smaller number: {experiment} has {sessions.seeds} seeds, "
                "numbered from 0"
            )
            raise InputError("", f"{name}.{last}", expected)


def check_beyond(beyond: Beyond, params: Params, runs: bool) -> None:
    """Check ``beyond`` against itself and ``params``;
    InputError for a wrong name, title, size or option.
    """
    for name, variant in beyond.variants.items() if runs else ():
        check_names(variant.experiments, params.experiments, f"variants.{name}.experiments")
        _check_variant(variant, params, f"variants.{name}")
    titles = [entry.title for entry in params.experiments.values()] + [
        graph.title for graph in beyond.graphs.values()
    ]
    if (
        not distinct(titles)
        or len({graph.sessions.sizes[0] for graph in beyond.graphs.values()}) > 1
    ):
        raise InputError(
            "",
            "graphs",
            "expected each title once in graphs and experiments, and equal sessions.sizes",
        )
    for name, graph in beyond.graphs.items():
        if name in params.experiments:
            raise InputError("", f"graphs.{name}", "expected a name that no experiment has")
        settings_of(graph.source, f"graphs.{name}.source")
        if runs:
            _check_variant(graph.variant(name), params, f"graphs.{name}")


def _check_variant(variant: Variant, params: Params, key: str) -> None:
    check_names(
        variant.initializers, {**params.initializers, **variant.options}, f"{key}.initializers"
    )
    for initializer, options in variant.options.items():
        options_of(initializer, options, f"{key}.options.{initializer}")
    with at("", f"{key}.changes"):
        changed = StageParams(params.model_dump(by_alias=True, exclude_unset=True)).changed(
            variant.changes
        )
        check_params(config.check(changed.values, Params, "", ""))


def main() -> None:
    """Check the params of all pipelines; with the argument ``beyond``, also those of the second
    pipeline alone.
    """
    with errors_in_one_line("params"):
        load_beyond(load(), runs="beyond" in sys.argv)


if __name__ == "__main__":
    main()
