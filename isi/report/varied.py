"""What lies beyond the paper: experiments under other conditions, where the second pipeline has run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from isi.analyses.other_graphs import GRAPH_QUERIES, GRAPH_RUNS
from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS, Variant
from isi.graph.tables import GRAPH_ENTITIES, GRAPH_TRIPLES
from isi.params import Params, load_beyond
from isi.report import parts
from isi.report.models import JOINT, label
from isi.report.statistics import HIGH, LOW, converged, over_seeds

_CELL = ["experiment", "model", "size", "seed"]


@dataclass(frozen=True, eq=False)
class Varied:
    """A variant, and what became of it when it last ran, which may be less than it lists by now."""

    how: Variant
    #: ``tables.VARIANTS`` and ``tables.VARIANTS_ASKED``
    runs: pd.DataFrame
    asked: pd.DataFrame

    @cached_property
    def experiments(self) -> list[str]:
        """Those that ran, in its order."""
        ran = set(self.runs["experiment"])
        return [name for name in self.how.experiments if name in ran]

    @cached_property
    def initializers(self) -> list[str]:
        """Those that ran, in its order."""
        ran = set(self.runs["model"])
        return [name for name in self.how.initializers if name in ran]

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    def at_once(self, experiment: str, scope: str) -> pd.DataFrame:
        """Runs right after insertion."""
        runs = self.runs
        return runs[(runs["experiment"] == experiment) & (runs["scope"] == scope) & (runs["epoch"] == 0)]

    @cached_property
    def about(self) -> pd.DataFrame:
        """The entity half of scope novel where the novel entity is asked about, a row for each model and cell."""
        cells = parts.directed(self.asked, _CELL)
        return cells[cells["scope"] == "given"].drop(columns="scope").reset_index(drop=True)

    def about_in(self, experiment: str) -> pd.DataFrame:
        """The same of one experiment."""
        return self.about[self.about["experiment"] == experiment]

    def most(self, params: Params) -> int:
        """Epochs of fine-tuning, at most."""
        return int(self.how.changes.get("finetuning.max_epochs", params.finetuning.max_epochs))

    def convergence(self, experiment: str, params: Params) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell."""
        own, most = self.runs[self.runs["experiment"] == experiment], self.most(params)
        joint = own["model"] == JOINT
        return converged(own[~joint], own[joint], params.convergence.margin, most, ["model"])


@dataclass(frozen=True, eq=False)
class Explored:
    """A graph of the second pipeline, and what became of it."""

    #: ``tables.ENTITIES`` and ``tables.TRIPLES``
    entities: pd.DataFrame
    triples: pd.DataFrame
    #: what was run on it, as the only experiment
    ran: Varied


def explored(params: Params) -> dict[str, Explored]:
    """Every graph of the second pipeline that has run, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    return {
        name: Explored(
            GRAPH_ENTITIES.read_text(graph=name),
            GRAPH_TRIPLES.read_text(graph=name),
            Varied(how.variant(name), GRAPH_RUNS.read_text(graph=name),
                   GRAPH_QUERIES.read_text(graph=name)),
        )
        for name, how in load_beyond(params).graphs.items() if GRAPH_QUERIES.path(graph=name).exists()
    }  # fmt: skip


def read(experiments: Collection[str], params: Params) -> dict[str, Varied]:
    """Every variant of the second pipeline that has run on any of the experiments, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    found = {
        name: Varied(
            how, _of(experiments, VARIANT_RUNS.read_text(variant=name)),
            _of(experiments, VARIANT_QUERIES.read_text(variant=name)),
        )
        for name, how in load_beyond(params).variants.items() if VARIANT_QUERIES.path(variant=name).exists()
    }  # fmt: skip
    return {name: one for name, one in found.items() if one.experiments}


def _of(experiments: Collection[str], frame: pd.DataFrame) -> pd.DataFrame:
    """The rows of some experiments."""
    return frame[frame["experiment"].isin(list(experiments))]


def group(varied: Mapping[str, Varied], name: str) -> dict[str, Varied]:
    """The variants of one group."""
    return {key: one for key, one in varied.items() if one.how.group == name}


def by_model(rows: pd.DataFrame, column: str, models: Sequence[str], scale: float = 100.0) -> dict[str, float]:
    """Mean of a column for each model that has any, with its interval over seeds, under labels: part of a row."""
    if rows.empty:
        return {}
    means = over_seeds(rows, ["model"], {column: ""}, scale)
    return {
        f"{label(model)}{end}": value
        for model in models
        if model in means.index
        for end, value in zip(
            ("", LOW, HIGH), means.loc[[model], ["", LOW, HIGH]].to_numpy(float)[0].tolist(), strict=True
        )
    }
