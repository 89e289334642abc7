"""All of ``params.yaml``: every section's own model, and what they must agree on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, field_validator, model_validator

from isi import config
from isi.analyses.affordances import Affordances
from isi.analyses.cross_validation import CrossValidation, Setting
from isi.analyses.final_model import FinalModel
from isi.analyses.finetune_only import FinetuneOnly
from isi.analyses.model_comparison import ModelComparison
from isi.analyses.query_breakdown import QueryBreakdown
from isi.analyses.single_insertions import SHOWN, Explorer
from isi.analyses.sweep import RateSweep, Sweep
from isi.analyses.trajectory import TRACED, Trajectories
from isi.config import Name, Section, Seed, Study, distinct
from isi.errors import InputError, meant
from isi.experiment.insert import Convergence, FullCurves, InitializerList, among
from isi.experiment.runner import Compute
from isi.graph.graph import GraphOf
from isi.graph.sampling import SessionsOf, Shares
from isi.graph.words import Words
from isi.initializers.api import options_of
from isi.models.model import EmbeddingParams, make_model
from isi.recording.settings import Recorder
from isi.sources import settings_of
from isi.tables import paths
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer, Training

#: Of cross-validation, which trains a model for each setting and fold.
MOST_SETTINGS = 13


class ExperimentOf(Section):
    """An entry under ``experiments``."""

    title: str
    graph: GraphOf
    sessions: SessionsOf
    initializers: InitializerList
    #: which are not fine-tuned
    at_once: list[Name]
    followed: FullCurves

    @property
    def lists_of_initializers(self) -> dict[str, InitializerList]:
        """By their keys."""
        return {"initializers": self.initializers, "at_once": self.at_once,
                "followed.initializers": self.followed.initializers}  # fmt: skip

    @model_validator(mode="after")
    def _lists_name_something_once(self) -> Self:
        for key, listed in (*self.lists_of_initializers.items(), ("sessions.novel", self.sessions.novel)):
            if isinstance(listed, list) and not (distinct(listed) and (listed or key == "at_once")):
                raise ValueError(f"{key}: expected a list of names that do not repeat")
        return self

    @model_validator(mode="after")
    def _added_where_extended(self) -> Self:
        if (self.sessions.novel == "added") != (self.graph.extend is not None):
            raise ValueError("sessions.novel: added goes with graph.extend, and with nothing else")
        if self.graph.extend and self.sessions.steps * max(self.sessions.sizes) > self.graph.extend.candidates:
            most = f"graph.extend.candidates ({self.graph.extend.candidates})"
            raise ValueError(f"sessions.steps times the largest of sessions.sizes must not be above {most}")
        return self


class Plots(Section):
    """Lines of ``dvc plots``."""

    initializers: list[Name]


class Params(Section):
    """Everything in ``params.yaml``."""

    seed: Seed
    sources: dict[Name, dict[str, Any]]
    experiments: Annotated[dict[Name, ExperimentOf], Field(min_length=1)]
    sessions: Shares
    words: Words
    embedding: EmbeddingParams
    families: dict[Name, dict[str, Any]]
    negatives: Negatives
    training: Training
    finetuning: Optimizer
    convergence: Convergence
    initializers: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)]
    plots: Plots
    nothing: FinetuneOnly
    sweep: Sweep
    cross_validation: CrossValidation
    rates: RateSweep
    approach: Trajectories
    compare_families: ModelComparison
    affordances: Affordances
    asking: QueryBreakdown
    compute: Compute
    recorder: Recorder
    kept: FinalModel
    explorer: Explorer

    @field_validator("initializers")
    @classmethod
    def _named(cls, value: dict[str, Any]) -> dict[str, Any]:
        if "joint" in value:
            raise ValueError("'joint' is the name of the joint model")
        return value

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        asked = [("plots.initializers", name, self.initializers) for name in self.plots.initializers]
        for study, varied in (("sweep", list(self.sweep.initializers)), ("rates", self.rates.initializers)):
            if getattr(self, study).experiments:
                asked += [(f"{study}.initializers", name, self.initializers) for name in varied]
        asked += [("compare_families.families", name, self.families) for name in self.compare_families.families]
        if self.approach.experiments:
            asked += [("approach.experiments: its initializers", name, self.initializers) for name in TRACED]
        if self.explorer.experiments:
            asked += [("explorer.experiments: its initializers", name, self.initializers) for name in SHOWN]
            others = {name: options for name, options in self.initializers.items() if name not in SHOWN}
            asked.append(("explorer.best", self.explorer.best, others))
        asked.append(("embedding.family", self.embedding.family, self.families))
        for key, experiment in self.experiments.items():
            where = f"experiments.{key}"
            asked.append((f"{where}.graph.source", experiment.graph.source, self.sources))
            if experiment.graph.extend:
                asked.append((f"{where}.graph.extend.source", experiment.graph.extend.source, self.sources))
            for listed, named in experiment.lists_of_initializers.items():
                if named != "all":
                    asked += [(f"{where}.{listed}", name, self.initializers) for name in named]
        for key, name, known in asked:
            if name not in known:
                expected = f"expected names among {', '.join(known)}, got {name!r}{meant(name, known)}"
                raise ValueError(f"{key}: {expected}")
        return self

    @model_validator(mode="after")
    def _studies_fit_their_experiments(self) -> Self:
        asked = {"sweep.seeds": self.sweep.seeds, "approach.seed": self.approach.seed + 1,
                 "compare_families.seeds": self.compare_families.seeds}  # fmt: skip
        for name, study in self.studies.items():
            for experiment in study.experiments:
                if experiment not in self.experiments:
                    expected = f"expected some of experiments, got {experiment!r}"
                    raise ValueError(f"{name}.experiments: {expected}{meant(experiment, self.experiments)}")
                sessions = self.experiments[experiment].sessions
                if getattr(study, "size", sessions.sizes[0]) not in sessions.sizes:
                    raise ValueError(f"{name}.size: expected one of the sizes of {experiment}")
        for key, seeds in asked.items():
            for experiment in getattr(self, key.partition(".")[0]).experiments:
                if seeds > self.experiments[experiment].sessions.seeds:
                    raise ValueError(f"{key}: expected no more than the seeds of {experiment} allow")
        return self

    @property
    def studies(self) -> dict[str, Study]:
        """What is done beside the main pipeline, by section."""
        found = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: section for name, section in found.items() if isinstance(section, Study)}

    @model_validator(mode="after")
    def _few_settings(self) -> Self:
        if len(self.settings) > MOST_SETTINGS:
            raise ValueError(f"cross_validation: expected at most {MOST_SETTINGS} settings, got {len(self.settings)}")
        return self

    @property
    def choice(self) -> Setting:
        """What all other experiments train with."""
        return Setting(
            dimension=self.embedding.dimension,
            ratio=self.negatives.ratio,
            learning_rate=self.training.learning_rate,
            weight_decay=self.training.weight_decay,
        )

    @property
    def settings(self) -> list[Setting]:
        """What cross-validation compares, the choice first."""
        return self.cross_validation.settings(self.choice)

    def initializers_of(self, experiment: str) -> list[str]:
        """The initializers that an experiment runs, in the order of params."""
        return [name for name in self.initializers if among(self.experiments[experiment].initializers, name)]


def load(path: Path = paths.PARAMS) -> Params:
    """Read and check all of ``params.yaml``.

    Raises:
        InputError: where the file is missing, is no YAML, or holds an unknown key, a wrong type
            or a value out of range; the message gives the key's path.
    """
    found = config.check(config.read(path), Params, "", path)
    try:
        for name, settings in found.sources.items():
            settings_of(settings, f"sources.{name}")
        for name, options in found.families.items():
            make_model(name, options, f"families.{name}")
        _check_dimensions(found)
        for name, options in found.initializers.items():
            options_of(name, options, f"initializers.{name}")
        for name, options in found.sweep.initializers.items():
            options_of(name, {**options, "k": found.sweep.k[0]}, f"sweep.initializers.{name}")
    except InputError as error:
        file, place, expected = error.args
        raise (InputError(path, place, expected) if file == str(paths.PARAMS) else error) from error
    return found


def _check_dimensions(found: Params) -> None:
    """See that the families in use have vectors of the dimensions that are asked for.

    Raises:
        InputError: where one has none.
    """
    asked = [("embedding.dimension", found.embedding.family, found.embedding.dimension)]
    if found.compare_families.experiments:
        others = found.compare_families.families
        asked += [("embedding.dimension", name, found.embedding.dimension) for name in others]
    if found.cross_validation.experiments:
        listed = found.cross_validation.dimension
        asked += [("cross_validation.dimension", found.embedding.family, dimension) for dimension in listed]
    for key, name, dimension in asked:
        try:
            make_model(name, found.families[name], f"families.{name}").width(dimension)
        except InputError as error:
            raise InputError(error.args[0], key, ": ".join(error.args[1:])) from error
