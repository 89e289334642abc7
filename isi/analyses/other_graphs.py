"""Experiments on graphs of their own, each run from its source on.

All params of the second pipeline.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from isi.analyses.hidden_entities import Hidden
from isi.analyses.variants import Variant
from isi.config import Count, Name, Section, check, read
from isi.experiment.store import Store
from isi.graph.graph import GraphTables
from isi.graph.sampling import SessionsOf, SessionTables
from isi.graph.words import Words
from isi.tables import paths


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


@dataclass(frozen=True)
class InMemoryStore(Store):
    """What a store has of an experiment, held in memory."""

    graph_tables: GraphTables
    #: word vectors of the entities; shape: (E, w)
    vectors: np.ndarray
    sessions: SessionTables

    def entities(self) -> pd.DataFrame:
        return self.graph_tables.entities

    def triples(self) -> pd.DataFrame:
        return self.graph_tables.triples

    def words(self) -> np.ndarray:
        return self.vectors

    def splits_listed(self) -> pd.DataFrame:
        return self.sessions.splits

    def novel(self) -> pd.DataFrame:
        return self.sessions.novel

    def insert_triples(self) -> pd.DataFrame:
        return self.sessions.insert_triples


class Beyond(Section):
    """The params of the second pipeline, of every stage."""

    graphs: Annotated[dict[Name, GraphExperiment], Field(default_factory=dict)]
    hidden: Annotated[dict[Name, Hidden], Field(default_factory=dict)]
    variants: dict[Name, Variant]


def load(path: Path = paths.BEYOND_PARAMS) -> Beyond:
    """All params of the second pipeline; empty where there is none.

    Raises:
        InputError: where a key is unknown, of another type or out of range.
    """
    return check(read(path) if path.exists() else {"variants": {}}, Beyond, "", path)
