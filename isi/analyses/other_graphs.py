"""Experiments on graphs of their own, each run from its source on."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field

from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS, Variant
from isi.config import Count, Name, Section
from isi.graph.sampling import SessionsOf
from isi.graph.words import Words

#: What the experiment of a graph gives.
GRAPH_RUNS = replace(VARIANT_RUNS, template="data/beyond/graphs/{graph}/runs.parquet")
GRAPH_QUERIES = replace(VARIANT_QUERIES, template="data/beyond/graphs/{graph}/queries.parquet")


class OneSize(SessionsOf):
    """Sessions of one size."""

    sizes: Annotated[list[Count], Field(min_length=1, max_length=1)]


class GraphExperiment(Section):
    """An entry of ``graphs`` in the params of the second pipeline."""

    #: what people read
    title: str
    #: a reader and its settings, as under ``sources``
    source: dict[str, Any]
    #: unique triples observed less often are dropped
    min_count: Count = 1
    words: Words
    sessions: OneSize
    initializers: Annotated[list[Name], Field(min_length=1)]
    #: values of params.yaml, by dotted key
    changes: Annotated[dict[str, Any], Field(default_factory=dict)]

    def variant(self, name: str) -> Variant:
        """How it is run: like a variant that trains all that it needs."""
        return Variant(
            title=self.title, group="graphs", experiments=[name], initializers=self.initializers,
            size=self.sessions.sizes[0], seeds=self.sessions.seeds, options={}, changes=self.changes, trained=True,
        )  # fmt: skip
