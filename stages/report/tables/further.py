"""Beyond the paper: stronger initializers, fewer insert triples, other words, embedding models and
graphs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd

from stages.report.tables.data import Experiment, Models, Runs, read
from stages.report.tables.estimates import BASELINE, Line, difference, named, where, wide
from stages.report.tables.registry import Frames, table
from stages.report.tables.results import by_label

if TYPE_CHECKING:
    from stages.check_params import Beyond, Params
    from stages.vary import Variant

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

    variant: "Variant | Any" = None
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
    def read(cls, params: "Params", beyond: "Beyond", models: Models) -> Self:
        """The experiments, and the variants and graphs that were run."""
        experiments = [
            Experiment.read(params, models, name)
            for name, settings in params.experiments.items()
            if not settings.graph.extend
        ]
        variants, graphs = list[VariantRuns](), list[VariantRuns]()
        for key, variant in beyond.variants.items():
            place = Path("data/beyond", key)
            if place.with_suffix(".queries.parquet").exists():
                runs = read(place.with_suffix(".parquet"))
                queries = read(place.with_suffix(".queries.parquet"))
                for experiment in experiments:
                    if experiment.name in variant.experiments:
                        made = _runs_of(experiment, params, key, variant, runs, queries)
                        variants += [made] if len(made.runs) else []
        for key, graph in beyond.graphs.items():
            folder = Path("data/beyond/graphs", key)
            if (folder / "queries.parquet").exists():
                runs, queries, entities, triples = (
                    read(folder / f"{name}.parquet")
                    for name in ("runs", "queries", "entities", "triples")
                )
                named = replace(experiments[0], name=key, title=graph.title)
                made = _runs_of(named, params, key, graph.variant(key), runs, queries)
                graphs.append(replace(made, entities=entities, triples=triples))
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
        listed = list[Runs]()
        for experiment in self.experiments if self.graphs else []:
            like = self.graphs[0].variant
            ran = experiment.initializers
            names = [name for name in like.initializers if name in ran]
            listed.append(replace(experiment.of_size(like.size), initializers=names))
        return [
            runs for runs in (*listed, *self.graphs) if len(runs.runs) and runs.queries is not None
        ]


def _runs_of(
    experiment: Runs,
    params: "Params",
    key: str,
    variant: "Variant",
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


# Other initializers, fewer insert triples, other words


@table("beyond")
def strong(results: Further) -> Frames:
    """Initializers beyond the paper on each graph, sorted by entity MRR with the novel entity
    given.
    """
    frames = dict[str, pd.DataFrame]()
    for runs in results.variants_of("baselines"):
        given, cells = runs.means("given"), runs.by_run("given")
        order = list(given["mean"].sort_values(ascending=False, kind="stable").index)
        reference = cells.get(REFERENCE, pd.Series(np.nan, cells.index))
        minus = {model: difference(cells[model], reference) for model in order}
        columns = named(runs.means("held_out"), "mean", "held_out")
        columns |= named(runs.means("novel"), "mean", "novel")
        columns |= named(given, "mean", "novel entity given")
        title = f"novel entity given, minus {runs.models.labels[REFERENCE]}"
        columns |= named(pd.DataFrame(minus).T, "difference", title)
        frames[f"strong_{runs.name}"] = by_label(runs.models, order, columns)
    return frames


@table("beyond")
def n_insert_triples(results: Further) -> pd.DataFrame:
    """Entity MRR with the novel entity given by number of insert triples, on the first graph with
    such runs.
    """
    variants, rows = results.variants_of("insert_triples"), list[Line]()
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


def _by_graph(listed: Sequence[Runs], variant: str = "") -> pd.DataFrame:
    """Entity MRR with the novel entity given: a row by model for each of the runs, those of a
    graph below each other; the column ``variant`` has the title of the variant.
    """
    names, rows = list(dict.fromkeys(runs.name for runs in listed)), list[Line]()
    for runs in sorted(listed, key=lambda runs: names.index(runs.name)):
        row: Line = {"graph": runs.title}
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
    rows = list[Line]()
    for runs in results.compared:
        row: Line = {"graph": runs.title}
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
    rows = list[Line]()
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
