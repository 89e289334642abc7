"""The store: tables and tensors of one experiment, checked against each other, as arrays that tasks take."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.experiment import agreement
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.tables import INITIAL_VECTORS, JOINT, RUNS, THETA0, TIES
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import OUT, SPLITS, Session
from isi.graph.tables import ENTITIES, INSERT_TRIPLES, NOVEL, TRIPLES, WORD_VECTORS
from isi.graph.tables import SPLITS as SPLIT_TABLE
from isi.models.model import Model
from isi.tables.table import DataFile, Table, TensorFile


@dataclass(frozen=True)
class Store:
    """Reads the files of one experiment, each table once.

    A file that does not agree with another one (``isi.experiment.agreement``) is refused as an ``InputError``.
    """

    experiment: str
    #: tables in memory, which are not read
    tables: dict[Table, pd.DataFrame] = field(default_factory=dict, repr=False)
    #: word vectors in memory; shape: (E, w)
    vectors: np.ndarray | None = field(default=None, repr=False)

    def table(self, table: Table) -> pd.DataFrame:
        """A table of the experiment."""
        if table not in self.tables:
            self.tables[table] = table.read(experiment=self.experiment)
        return self.tables[table]

    def entities(self) -> pd.DataFrame:
        return self.table(ENTITIES)

    def triples(self) -> pd.DataFrame:
        return self.table(TRIPLES)

    def novel(self) -> pd.DataFrame:
        return self.table(NOVEL)

    def graph(self) -> Graph:
        return build_graph(self.entities(), self.triples(), self._path(TRIPLES))

    def words(self) -> np.ndarray:
        """Word vectors of the entities; shape: (E, w)."""
        if self.vectors is not None:
            return self.vectors
        (vectors,) = self._arrays(WORD_VECTORS, "vectors")
        shape = (len(self.entities()), *vectors.shape[-1:])
        agreement.has_shape(self._path(WORD_VECTORS), "vectors", vectors, shape)
        return vectors

    def splits(self) -> dict[int, np.ndarray]:
        """Split of each unique triple, by seed, OUT where it has none; shapes: (T,), int8."""
        table, triples = self.table(SPLIT_TABLE), len(self.triples())
        agreement.ids_below(self._path(SPLIT_TABLE), table, "triple", triples, "graph's triples")
        codes = table["split"].astype(str).map({name: number for number, name in enumerate(SPLITS)})
        splits = {seed: np.full(triples, OUT, dtype=np.int8) for seed in sorted(table["seed"].unique().tolist())}
        for seed, rows in table.assign(code=codes.astype(np.int8)).groupby("seed"):
            splits[seed][rows["triple"]] = rows["code"]
        return splits

    def insert_triples(self) -> pd.DataFrame:
        given, graph, path = self.table(INSERT_TRIPLES), self.graph(), self._path(INSERT_TRIPLES)
        agreement.ids_below(path, given, "triple", len(graph.triples), "graph's triples")
        agreement.insert_triples_fit(path, given, self.novel(), graph)
        agreement.insert_triples_train(path, given, self.splits())
        return given

    def theta0(self, points: GridPoints, model: Model) -> StackedVectors:
        """Θ⁰ of a stack of grid points."""
        return self._embedding(THETA0, points, model, points.session(0))

    def joint(self, points: GridPoints, model: Model, session: int = 1) -> StackedVectors:
        """The joint models of a session of a stack of grid points."""
        return self._embedding(JOINT, points, model, points.session(session), points.joint_prefix(session))

    def _embedding(
        self, file: TensorFile, points: GridPoints, model: Model, session: Session, prefix: str = ""
    ) -> StackedVectors:
        path = self._path(file, size=points.size)
        names = [f"{prefix}{name}" for name in ("entity", "relation", "known", "seed")]
        entity, relation, known, seed = self._arrays(file, *names, size=points.size)
        agreement.seeds_are(path, seed, self._seeds, entity, relation, known)
        rows = np.flatnonzero(np.isin(seed, points.seeds))
        theta = StackedVectors(model, entity[rows], relation[rows])
        agreement.vectors_fit(path, theta, known[rows], session)
        return theta

    def initial_vectors(self, initializer: str, points: GridPoints) -> np.ndarray:
        """What an initializer inserted in the first session of a stack of grid points; shape (M, size, d)."""
        path, name = self._path(INITIAL_VECTORS, initializer=initializer), f"size={points.size:02d}"
        (vectors,) = self._arrays(INITIAL_VECTORS, name, initializer=initializer)
        dimension = THETA0.shape("entity", experiment=self.experiment, size=points.size)[-1:]
        agreement.has_shape(path, name, vectors, (len(self._seeds), points.sessions * points.size, *dimension))
        return vectors[np.isin(self._seeds, points.seeds), : points.size]

    def _path(self, file: DataFile, **names: str | int) -> Path:
        return file.path(experiment=self.experiment, **names)

    def _arrays(self, file: TensorFile, *tensors: str, **names: str | int) -> list[np.ndarray]:
        return [tensor.numpy() for tensor in file.read(tensors, experiment=self.experiment, **names).values()]

    @cached_property
    def _seeds(self) -> list[int]:
        """Of the sessions of every size."""
        return sorted(self.novel()["seed"].unique().tolist())

    def grid(self, stack: int, size: int | None = None, seeds: int | None = None) -> list[GridPoints]:
        """Every point of the grid, in stacks of at most ``stack`` seeds of one size.

        Args:
            size: only of this size.
            seeds: only of the first so many seeds.
        """
        graph, splits, novel, path = self.graph(), self.splits(), self.novel(), self._path(NOVEL)
        agreement.ids_below(path, novel, "entity", len(graph.entities), "graph's entities")
        agreement.novel_sets_are_whole(path, novel, splits)
        sources = self.entities()["source"].to_numpy(str)
        agreement.splits_are_whole(self._path(SPLIT_TABLE), splits, graph, sources, novel)
        chosen = novel if size is None else novel[novel["size"] == size]
        if seeds is not None:
            chosen = chosen[chosen["seed"] < seeds]
        if chosen.empty:
            raise InputError(path, "column 'size'", f"expected a set of {size} novel entities: see sessions in params")
        points = []
        for number in sorted(chosen["size"].unique().tolist()):
            rows = chosen[chosen["size"] == number]
            drawn_in = rows["seed"].unique().tolist()
            drawn = rows["entity"].to_numpy(np.int64).reshape(len(drawn_in), -1, number)
            for first in range(0, len(drawn_in), stack):
                part = drawn_in[first : first + stack]
                codes = np.stack([splits[seed] for seed in part])
                points.append(GridPoints(self.experiment, graph, number, part, codes, drawn[first : first + stack]))
        return points

    def insert_triples_of(self, points: GridPoints, table: pd.DataFrame) -> np.ndarray:
        """(session, model, place in ``novel``, triple) of the insert triples of a stack; shape (I, 4)."""
        given = table[(table["size"] == points.size) & table["seed"].isin(points.seeds)]
        model = given["seed"].map({seed: number for number, seed in enumerate(points.seeds)}).to_numpy(np.int64)
        session = given["session"].to_numpy(np.int64)
        place = (points.novel[model, session - 1] == given["entity"].to_numpy()[:, None]).argmax(1)
        rows = np.stack([session, model, place, given["triple"].to_numpy(np.int64)], 1)
        return rows[np.lexsort(rows.T[::-1])]


def write_runs(runs: pd.DataFrame, stage: str, experiment: str, model: str) -> None:
    """Write the measures of a model at every epoch, and its ties at epoch 0."""
    TIES.write(runs[runs["epoch"] == 0], stage, experiment=experiment, model=model)
    RUNS.write(runs, stage, experiment=experiment, model=model)
