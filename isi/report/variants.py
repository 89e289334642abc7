"""Runs of the second pipeline, beyond the paper: experiments under other conditions, and other graphs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from isi.analyses.other_graphs import GRAPH_QUERIES, GRAPH_RUNS
from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS, Variant
from isi.graph.tables import GRAPH_ENTITIES, GRAPH_TRIPLES
from isi.params import Params, load_beyond
from isi.report.models import JOINT
from isi.report.stats import by_direction, converged, over_seeds
from isi.report.tables import Estimate

_CELL = ["experiment", "model", "size", "seed"]


@dataclass(frozen=True, eq=False)
class VariantRuns:
    """The runs of a variant; they may be of fewer experiments and initializers than it lists by now."""

    variant: Variant
    #: ``tables.VARIANTS`` and ``tables.VARIANTS_ASKED``
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

    @cached_property
    def given_queries(self) -> pd.DataFrame:
        """The entity half of the queries that give the novel entity, a row for each model and cell."""
        cells = by_direction(self.queries, _CELL)
        return cells[cells["scope"] == "given"].drop(columns="scope").reset_index(drop=True)

    def given_in(self, experiment: str) -> pd.DataFrame:
        """The same in one experiment."""
        return self.given_queries[self.given_queries["experiment"] == experiment]

    def max_epochs(self, params: Params) -> int:
        """Epochs of fine-tuning, at most."""
        return int(self.variant.changes.get("finetuning.max_epochs", params.finetuning.max_epochs))

    def convergence(self, experiment: str, params: Params) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell."""
        runs, most = self.runs[self.runs["experiment"] == experiment], self.max_epochs(params)
        joint = runs["model"] == JOINT
        return converged(runs[~joint], runs[joint], params.convergence.margin, most, ["model"])

    def immediate_means(self, experiment: str, scope: str) -> dict[str, Estimate]:
        """MRR* right after insertion by model."""
        return by_model(self.immediate(experiment, scope), "mrr_star", self.models)

    def given_means(self, experiment: str) -> dict[str, Estimate]:
        """The entity half of the queries that give the novel entity, by model."""
        return by_model(self.given_in(experiment), "mrr_star_entity", self.models)

    def epochs_means(self, experiment: str, params: Params) -> dict[str, Estimate]:
        """Epochs to convergence on held-out triples of the novel entities, by initializer."""
        cells = self.convergence(experiment, params)
        return by_model(cells[cells["scope"] == "novel_heldout"], "epochs", self.initializers, scale=1)


@dataclass(frozen=True, eq=False)
class OtherGraph:
    """A graph of the second pipeline, and the runs on it."""

    #: ``tables.ENTITIES`` and ``tables.TRIPLES``
    entities: pd.DataFrame
    triples: pd.DataFrame
    runs: VariantRuns


def read(experiments: Collection[str], params: Params) -> dict[str, VariantRuns]:
    """Every variant of the second pipeline that has run on any of the experiments, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    names = list(experiments)
    runs_of = {}
    for name, variant in load_beyond(params).variants.items():
        if VARIANT_QUERIES.path(variant=name).exists():
            runs, queries = VARIANT_RUNS.read_text(variant=name), VARIANT_QUERIES.read_text(variant=name)
            runs_of[name] = VariantRuns(
                variant, runs[runs["experiment"].isin(names)], queries[queries["experiment"].isin(names)]
            )
    return {name: runs for name, runs in runs_of.items() if runs.experiments}


def read_other_graphs(params: Params) -> dict[str, OtherGraph]:
    """Every graph of the second pipeline that has run, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    return {
        name: OtherGraph(
            GRAPH_ENTITIES.read_text(graph=name),
            GRAPH_TRIPLES.read_text(graph=name),
            VariantRuns(graph.variant(name), GRAPH_RUNS.read_text(graph=name), GRAPH_QUERIES.read_text(graph=name)),
        )
        for name, graph in load_beyond(params).graphs.items()
        if GRAPH_QUERIES.path(graph=name).exists()
    }


def of_group(variants: Mapping[str, VariantRuns], group: str) -> dict[str, VariantRuns]:
    """The variants of one group."""
    return {name: runs for name, runs in variants.items() if runs.variant.group == group}


def by_model(rows: pd.DataFrame, column: str, models: Sequence[str], scale: float = 100.0) -> dict[str, Estimate]:
    """Mean of a column for each model that has any, in the models' order."""
    if rows.empty:
        return {}
    means = over_seeds(rows, ["model"], {column: "mean"}, scale)["mean"]
    return {model: means[model] for model in models if model in means.index}
