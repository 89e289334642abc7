"""Run an experiment on another graph: mine, sample sessions, train, insert."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import pandas as pd
from pydantic import Field

from isi.config import Name, Section, ensure
from isi.errors import InputError, at
from isi.graph.graph import GraphTables, MinedSource, build_graph, build_tables
from isi.graph.words import look_up
from isi.sources import Source
from stages.embed_words import Words, load_vectors
from stages.files import ENTITIES, TRIPLES
from stages.make_sessions import SessionsOf, Shares, session_tables
from stages.pipeline import BEYOND_PARAMS
from stages.stage import StageContext, stage
from stages.store import Store
from stages.vary import VARIANT_QUERIES, VARIANT_RUNS, Changes, Variant, results, variant_config

#: ``ENTITIES`` and ``TRIPLES`` of a graph of the second pipeline.
GRAPH_ENTITIES = replace(ENTITIES, template="data/beyond/graphs/{graph}/entities.parquet")
GRAPH_TRIPLES = replace(TRIPLES, template="data/beyond/graphs/{graph}/triples.parquet")
#: Runs of the initializers and the joint model, and the query breakdown at epoch 0.
GRAPH_RUNS = replace(VARIANT_RUNS, template="data/beyond/graphs/{graph}/runs.parquet")
GRAPH_QUERIES = replace(VARIANT_QUERIES, template="data/beyond/graphs/{graph}/queries.parquet")


def has_one_size(sessions: SessionsOf) -> bool:
    """Whether sessions have one set size."""
    return len(sessions.sizes) == 1


class GraphExperiment(Section):
    """An entry of ``graphs`` in the params of the second pipeline:
    an experiment on a graph of its own.
    """

    title: str  #: in the report
    source: dict[str, Any]  #: a reader and its settings, as under ``sources``
    words: Words
    sessions: Annotated[SessionsOf, ensure(has_one_size, "one size")]
    initializers: Annotated[list[Name], Field(min_length=1)]
    changes: Changes

    def variant(self, name: str) -> Variant:
        """This experiment as a variant, which trains Θ⁰ and the joint model itself."""
        return Variant(
            title=self.title,
            group="graphs",
            experiments=[name],
            initializers=self.initializers,
            size=self.sessions.sizes[0],
            seeds=self.sessions.seeds,
            options={},
            changes=self.changes,
            finetuned=False,
            trained=True,
        )


@stage
def explore(context: StageContext, graph: str) -> None:
    key, params = f"graphs.{graph}", context.params
    settings: GraphExperiment = context.beyond.read(key, GraphExperiment)
    shares: Shares = params.read("sessions", Shares)
    root = params.seed
    with at(BEYOND_PARAMS, key):
        tables = build_tables(mined(graph, settings, root, f"{key}.source"))
        if tables.triples.empty:
            raise InputError("", "source", "expected triples, got none")
        store = store_of(graph, tables, settings, shares, root, key)
    variant = settings.variant(graph)
    config = variant_config(params.changed(variant.changes), variant)
    runs, answers = results(variant, [(store, config)], graph)
    for table, rows in (
        (GRAPH_ENTITIES, tables.entities),
        (GRAPH_TRIPLES, tables.triples),
        (GRAPH_RUNS, runs),
        (GRAPH_QUERIES, answers),
    ):
        table.write(rows, context.stage, graph=graph)


def mined(graph: str, settings: GraphExperiment, root: int, key: str) -> MinedSource:
    """Mine the observations and entities of the source."""
    source = Source(settings.source, key, root)
    observations = pd.concat(source.frames())
    for step, instances in source.counts.items():
        print(f"{instances:,} {step}")
    return MinedSource(graph, observations, source.kinds)


def store_of(
    name: str,
    tables: GraphTables,
    settings: GraphExperiment,
    shares: Shares,
    root: int,
    key: str,
) -> Store:
    """A store in memory of a graph, its word vectors and its sessions, whose params lie at
    ``key``.
    """
    vectors = look_up(load_vectors(settings.words), list(tables.entities["phrase"]))
    graph = build_graph(tables.entities, tables.triples)
    rows = session_tables(
        graph, tables.entities, settings.sessions, shares, root, f"{key}.sessions"
    )
    with_words = len(tables.entities) - vectors.served_by.count(None)
    print(tables, f"{with_words} of {len(tables.entities)} entities have a word vector", sep="\n")
    in_memory = {ENTITIES: tables.entities, TRIPLES: tables.triples, **rows}
    return Store(name, in_memory, vectors.vectors)


if __name__ == "__main__":
    explore()
