"""The pydantic models of ``params.yaml`` and ``beyond/params.yaml``, and checks across their
sections.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import Field

from isi import config
from isi.analyses import variants
from isi.analyses.affordances import Affordances
from isi.analyses.finetuning import Sweep
from isi.analyses.joint_models import CrossValidation, Setting
from isi.analyses.trajectory import NovelSet, Trajectories, traced
from isi.analyses.variants import GraphExperiment, Variant, VariantConfig
from isi.config import Count, EachOnce, Name, Section, Seed, Study, check_names, distinct
from isi.errors import InputError, at
from isi.experiment.insert import Convergence, Finetuned, InitializerList, InsertConfig, is_listed
from isi.experiment.train import TrainConfig
from isi.graph.graph import GraphOf
from isi.graph.sessions import SessionsOf, Shares
from isi.graph.words import Words
from isi.initializers.api import options_of
from isi.models.model import EmbeddingParams, Model, make_model
from isi.sources import settings_of
from isi.sources.recordings import Recorder
from isi.tables import paths
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer, Training, compile_ahead
from stages.runner import Compute

S = TypeVar("S", bound=Section)

#: Maximum number of settings in cross-validation; a setting trains one model per fold.
MOST_SETTINGS = 13
#: Sections that an experiment may replace for itself.
CONDITIONS = ("negatives", "training", "finetuning")


class ExperimentOf(Section):
    """An entry under ``experiments``."""

    rules = (
        (
            lambda entry: (entry.sessions.novel == "added") == (entry.graph.extend is not None),
            "expected sessions.novel: added with graph.extend, and another value without it",
        ),
        (
            lambda entry: (
                not entry.graph.extend or max(entry.sessions.sizes) <= entry.graph.extend.candidates
            ),
            "sessions: expected max(sizes) ≤ graph.extend.candidates",
        ),
        (
            lambda entry: set(entry.full_curves) <= set(entry.sessions.sizes),
            "full_curves: expected sizes among sessions.sizes",
        ),
    )
    title: str
    graph: GraphOf
    sessions: SessionsOf
    initializers: InitializerList
    finetuned: Finetuned
    #: sizes that are fine-tuned for all epochs, for the learning curves; the others until they
    #: converge
    full_curves: Annotated[list[Count], EachOnce]
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
        entry, changes = self.experiments[experiment], dict[str, Any]()
        for section in CONDITIONS:
            for key, value in (getattr(entry, section) or {}).items():
                changes[f"{section}.{key}"] = value
        with at("", f"experiments.{experiment}"):
            return variants.changed(self, changes)

    def initializers_of(self, experiment: str) -> list[str]:
        """The initializers that an experiment runs, in the order of params."""
        return [
            name
            for name in self.initializers
            if is_listed(self.experiments[experiment].initializers, name)
        ]

    def model_of(self, name: str | None = None) -> Model:
        """The model ``name`` (None: ``embedding.model``), with its options."""
        name = name or self.embedding.model
        return make_model(name, self.models[name], f"models.{name}")

    def train_config(
        self, model: Model | None = None, training: Training | None = None
    ) -> TrainConfig:
        """The config of Θ⁰ and the joint models; None: the model and the training of params."""
        model = model or self.model_of()
        training = training or self.training
        compile_ahead(model, training.batch_size)
        return TrainConfig(
            root=self.seed,
            model=model,
            dimension=self.embedding.dimension,
            init_range=self.embedding.init_range,
            negatives=self.negatives,
            training=training,
        )

    def insert_config(
        self,
        initializer: str,
        full_curves: Sequence[int] = (),
        options: Mapping[str, Any] | None = None,
    ) -> InsertConfig:
        """The config of an initializer, with ``options`` (None: those of params).

        An ``InputError`` names an invalid option.
        """
        options = self.initializers[initializer] if options is None else options
        compile_ahead(self.model_of(), self.finetuning.batch_size)
        return InsertConfig(
            initializer=initializer,
            options=options_of(initializer, options, f"initializers.{initializer}"),
            root=self.seed,
            negatives=self.negatives,
            optimizer=self.finetuning,
            margin=self.convergence.margin,
            full_curves=full_curves,
        )

    def variant_config(self, variant: Variant) -> VariantConfig:
        """The config of a variant; these params include its changes."""
        inserted = {
            name: self.insert_config(name, options=variant.options.get(name))
            for name in variant.initializers
        }
        words = self.words if variant.changes_one_of("words") else None
        return VariantConfig(self.train_config(), inserted, words, self.compute)


class Beyond(Section):
    """All sections of ``beyond/params.yaml``."""

    graphs: dict[Name, GraphExperiment] = Field(default_factory=dict)
    variants: dict[Name, Variant] = Field(default_factory=dict)


def load(path: Path = paths.PARAMS) -> Params:
    """Read and check ``params.yaml``; InputError names the dotted key that is wrong."""
    return _load(path, Params, check_params)


def load_beyond(
    params: Params, path: Path | None = paths.BEYOND_PARAMS, *, runs: bool = True
) -> Beyond:
    """Read ``beyond/params.yaml`` (empty if ``path`` is None or missing),
    and check it alone and against ``params``.

    Without ``runs``, variants and graphs may name experiments and initializers that ``params``
    lack.
    """
    if path is None or not path.exists():
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
    for key, listed, known in _listed_names(params):
        check_names(listed, known, key)
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
        check_params(variants.changed(params, variant.changes))
