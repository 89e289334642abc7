"""Beyond the paper: stronger initializers, fewer insert triples, other words, embedding models and
graphs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, Self

import numpy as np
import pandas as pd

from stages.check_params import Beyond, Params
from stages.explore import GRAPH_ENTITIES, GRAPH_QUERIES, GRAPH_RUNS, GRAPH_TRIPLES
from stages.report.scopes import DIRECTIONS
from stages.report.tables.data import Experiment, ModelLabels, Runs
from stages.report.tables.estimates import BASELINE, TableRow, difference, named, where, wide
from stages.report.tables.method import described
from stages.report.tables.registry import table
from stages.vary import VARIANT_QUERIES, VARIANT_RUNS, Variant

#: The initializer with which all others are compared, paired by seed.
REFERENCE = "ers"
#: Pairs of initializers that are compared on each graph, with the novel entity given.
PAIRS = (
    ("ers", BASELINE),
    ("ers", "kind_mean"),
    ("es", "es_permuted"),
    ("soft_hybrid", "ers"),
    ("map", "soft_hybrid"),
)


@dataclass(frozen=True, eq=False)
class VariantRuns(Runs):
    """The runs of a variant on one experiment, or on a graph of the second pipeline."""

    variant: Variant | Any = None
    key: str = ""  #: of the variant in params
    #: those of a graph; empty for a variant
    entities: pd.DataFrame = field(default_factory=pd.DataFrame)
    triples: pd.DataFrame = field(default_factory=pd.DataFrame)


@dataclass(frozen=True, eq=False)
class Further:
    """The runs of the second pipeline, and the experiments with which they are compared."""

    experiments: list[Experiment]  #: whose entities all come from one source
    variants: list[VariantRuns]
    graphs: list[VariantRuns]

    @classmethod
    def read(cls, params: Params, beyond: Beyond, models: ModelLabels) -> Self:
        """The experiments, and the variants and graphs that were run."""
        experiments = [
            Experiment.read(params, models, name)
            for name, settings in params.experiments.items()
            if not settings.graph.extend
        ]
        variants, graphs = list[VariantRuns](), list[VariantRuns]()
        for key, variant in beyond.variants.items():
            if VARIANT_QUERIES.path(variant=key).exists():
                variants += _variant_runs(params, experiments, key, variant)
        for key, graph in beyond.graphs.items():
            if GRAPH_QUERIES.path(graph=key).exists():
                like = replace(experiments[0], name=key, title=graph.title)
                graphs.append(_graph_runs(params, like, key, graph.variant(key)))
        return cls(experiments, variants, graphs)

    def variants_of(self, group: str) -> list[VariantRuns]:
        """The variants of one group."""
        return [runs for runs in self.variants if runs.variant.group == group]

    @property
    def all_graphs(self) -> list[Experiment | VariantRuns]:
        """The graphs of the experiments, then the others; none without others."""
        return [*self.experiments, *self.graphs] if self.graphs else []

    @property
    def compared(self) -> list[Runs]:
        """Runs of the same size and initializers on every graph; none without other graphs."""
        if not self.graphs:
            return []
        like = self.graphs[0].variant
        runs = list[Runs]()
        for experiment in self.experiments:
            names = [name for name in like.initializers if name in experiment.initializers]
            runs.append(replace(experiment.of_size(like.size), initializers=names))
        runs += self.graphs
        return [each for each in runs if len(each.runs) and each.queries is not None]


def _variant_runs(
    params: Params, experiments: Sequence[Experiment], key: str, variant: Variant
) -> list[VariantRuns]:
    """The runs of a variant on each of its experiments that has some."""
    runs, queries = VARIANT_RUNS.read_text(variant=key), VARIANT_QUERIES.read_text(variant=key)
    parts = list[VariantRuns]()
    for experiment in experiments:
        if experiment.name in variant.experiments:
            parts.append(_runs_of(experiment, params, key, variant, runs, queries))
    return [part for part in parts if len(part.runs)]


def _graph_runs(params: Params, like: Experiment, key: str, variant: Variant) -> VariantRuns:
    """The runs on a graph, with its entities and triples; ``like``: an experiment with its name and
    title.
    """
    runs, queries = GRAPH_RUNS.read_text(graph=key), GRAPH_QUERIES.read_text(graph=key)
    of_graph = _runs_of(like, params, key, variant, runs, queries)
    entities, triples = GRAPH_ENTITIES.read_text(graph=key), GRAPH_TRIPLES.read_text(graph=key)
    return replace(of_graph, entities=entities, triples=triples)


def _runs_of(
    experiment: Runs,
    params: Params,
    key: str,
    variant: Variant,
    runs: pd.DataFrame,
    queries: pd.DataFrame,
) -> VariantRuns:
    """The rows of an experiment or graph in a variant's tables."""
    of_experiment = where(runs, experiment=experiment.name)
    ran = set(of_experiment["model"])
    changed = variant.changes.get("finetuning.max_epochs", params.finetuning.max_epochs)
    return VariantRuns(
        name=experiment.name,
        title=experiment.title,
        models=experiment.models,
        initializers=[name for name in variant.initializers if name in ran],
        runs=of_experiment,
        queries=where(queries, experiment=experiment.name),
        margin=params.convergence.margin,
        max_epochs=int(changed),
        variant=variant,
        key=key,
    )


@table("beyond", "run")
def run_beyond(results: Further) -> pd.DataFrame:
    """The sizes and seeds of variants and graphs, versions and the commit of the code."""
    sizes = {
        kind: {each.key: {"size": each.variant.size, "seeds": each.variant.seeds} for each in runs}
        for kind, runs in (("variants", results.variants), ("graphs", results.graphs))
    }
    return described(sizes)


# Other initializers, fewer insert triples, other words


@table("beyond", "strong_{}")
def strong(results: Further) -> dict[str, pd.DataFrame]:
    """Initializers beyond the paper on each graph, sorted by entity MRR with the novel entity
    given.
    """
    frames = dict[str, pd.DataFrame]()
    for runs in results.variants_of("baselines"):
        means, cells = runs.means("given"), runs.by_run("given")
        order = list(means["mean"].sort_values(ascending=False, kind="stable").index)
        reference = cells.get(REFERENCE, pd.Series(np.nan, cells.index))
        minus = {model: difference(cells[model], reference) for model in order}
        columns = named(runs.means("held_out"), "mean", "held_out")
        columns |= named(runs.means("novel"), "mean", "novel")
        columns |= named(means, "mean", DIRECTIONS["given"])
        title = f"{DIRECTIONS['given']}, minus {runs.models.labels[REFERENCE]}"
        columns |= named(pd.DataFrame(minus).T, "difference", title)
        frames[runs.name] = runs.models.by_label(order, columns)
    return frames


@table("beyond")
def n_insert_triples(results: Further) -> pd.DataFrame:
    """Entity MRR with the novel entity given by number of insert triples, on the first graph with
    such runs.
    """
    variants, rows = results.variants_of("insert_triples"), list[TableRow]()
    for runs in variants:
        if runs.name == variants[0].name:
            most = runs.variant.max_insert_triples
            number = {"insert triples": "all" if most is None else str(most)}
            rows.append(number | wide(runs.means("given"), "mean", runs.models.labels))
    return pd.DataFrame(rows)


@table("beyond")
def other_words(results: Further) -> pd.DataFrame:
    """Entity MRR with the novel entity given by graph and kind of word vectors."""
    return _by_graph(results.variants_of("words"), "words")


# Other embedding models and graphs


def _by_graph(all_runs: Sequence[Runs], variant: str = "") -> pd.DataFrame:
    """Entity MRR with the novel entity given: a row by model for each of the runs, those of a
    graph below each other; the column ``variant`` has the title of the variant.
    """
    by_name = dict[str, list[Runs]]()
    for runs in all_runs:
        by_name.setdefault(runs.name, []).append(runs)
    rows = list[TableRow]()
    for runs in chain.from_iterable(by_name.values()):
        row: TableRow = {"graph": runs.title}
        if isinstance(runs, VariantRuns) and variant:
            row[variant] = runs.variant.title
        rows.append(row | wide(runs.means("given"), "mean", runs.models.labels))
    return pd.DataFrame(rows)


@table("beyond")
def embeddings_novel_given(results: Further) -> pd.DataFrame:
    """Other embedding models, by graph."""
    return _by_graph(results.variants_of("embeddings"), "embedding")


@table("beyond")
def graphs_novel_given(results: Further) -> pd.DataFrame:
    """All graphs, with sessions of the same size."""
    return _by_graph(results.compared)


@table("beyond")
def graphs_gains(results: Further) -> pd.DataFrame:
    """Differences of ``PAIRS`` in entity MRR with the novel entity given, on all graphs."""
    rows = list[TableRow]()
    for runs in results.compared:
        row: TableRow = {"graph": runs.title}
        for first, second in PAIRS:
            if {first, second} <= set(runs.rows):
                points = runs.minus("given", first, second)
                title = f"{runs.models.labels[first]} minus {runs.models.labels[second]}"
                row |= named(points, "difference", title)
        rows.append(row)
    return pd.DataFrame(rows)


@table("beyond")
def graphs(results: Further) -> pd.DataFrame:
    """The size of each graph, and the per cent of triples whose relation is that which the tail's
    kind predicts.
    """
    rows = list[TableRow]()
    for graph in results.all_graphs:
        entities, triples = graph.entities, graph.triples
        kinds = entities["kind"].value_counts()
        predicted = relations_by_kind(entities, triples).max(axis=1).sum()
        row = {
            "graph": graph.title,
            "observations": int(triples["count"].sum()),
            "unique triples": len(triples),
            "relations": triples["relation"].nunique(),
            "entities": len(entities),
            "kinds": ", ".join(f"{number} {kind}" for kind, number in kinds.items()),
            "predicted by kind %": 100 * predicted / len(triples),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def relations_by_kind(entities: pd.DataFrame, triples: pd.DataFrame) -> pd.DataFrame:
    """Number of unique triples: a row for each kind of tail, a column for each relation."""
    kinds = triples["tail"].map(entities.set_index("entity")["kind"])
    return triples.groupby([kinds.rename("kind"), "relation"]).size().unstack(fill_value=0)
