"""An experiment's tables and tensors, between where the pipeline keeps them and what tasks take and give."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.experiment.grid import GridPoints, StackedVectors
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import OUT, SPLITS, Session
from isi.models.model import Model
from isi.tables import catalogue, checks, io, paths
from isi.tables.provenance import Provenance


@dataclass(frozen=True)
class Store:
    """Reads the files of one experiment, noting each in the provenance of the stage that reads.

    Whatever does not agree with what it stands beside (``isi.tables.checks``) is refused as an ``InputError``.
    """

    experiment: str
    provenance: Provenance

    def entities(self) -> pd.DataFrame:
        return io.read(paths.entities(self.experiment), catalogue.ENTITIES, self.provenance)

    def triples(self) -> pd.DataFrame:
        return io.read(paths.triples(self.experiment), catalogue.TRIPLES, self.provenance)

    def graph(self) -> Graph:
        return build_graph(self.entities(), self.triples(), paths.triples(self.experiment))

    def words(self) -> np.ndarray:
        """Word vectors of the entities; shape: (E, w)."""
        path = paths.vectors(self.experiment)
        (vectors,) = self.tensors(path, "vectors")
        checks.has_shape(path, "vectors", vectors, (len(self.entities()), *vectors.shape[-1:]))
        return vectors

    def splits_listed(self) -> pd.DataFrame:
        return io.read(paths.splits(self.experiment), catalogue.SPLITS, self.provenance)

    def splits(self) -> dict[int, np.ndarray]:
        """Split of each unique triple, by seed, OUT where it has none; shapes: (T,), int8."""
        table, triples = self.splits_listed(), len(self.triples())
        checks.ids_below(paths.splits(self.experiment), table, "triple", triples, "graph's triples")
        codes = table["split"].astype(str).map({name: number for number, name in enumerate(SPLITS)})
        splits = {seed: np.full(triples, OUT, dtype=np.int8) for seed in sorted(table["seed"].unique().tolist())}
        for seed, rows in table.assign(code=codes.astype(np.int8)).groupby("seed"):
            splits[seed][rows["triple"]] = rows["code"]
        return splits

    def novel(self) -> pd.DataFrame:
        return io.read(paths.novel(self.experiment), catalogue.NOVEL, self.provenance)

    def insert_triples(self) -> pd.DataFrame:
        path = paths.insert_triples(self.experiment)
        told, graph = io.read(path, catalogue.INSERT_TRIPLES, self.provenance), self.graph()
        checks.ids_below(path, told, "triple", len(graph.triples), "graph's triples")
        checks.told_of_their_entity(path, told, self.novel(), graph)
        checks.told_from_train(path, told, self.splits())
        return told

    def tensors(self, path: Path, *names: str) -> list[np.ndarray]:
        """Named tensors of a file, as arrays."""
        return [tensor.numpy() for tensor in io.read_tensors(path, names, self.provenance).values()]

    def runs(self, name: str) -> pd.DataFrame:
        return io.read(paths.runs(self.experiment, name), catalogue.RUNS, self.provenance)

    def theta0(self, points: GridPoints, family: Model) -> StackedVectors:
        """Θ⁰ of a stack of grid points."""
        return self._embedding(paths.theta0(self.experiment, points.size), points, family, points.session(0))

    def joint(self, points: GridPoints, family: Model) -> StackedVectors:
        """The joint models of a stack of grid points."""
        return self._embedding(paths.joint(self.experiment), points, family, points.joint)

    def _embedding(self, path: Path, points: GridPoints, family: Model, session: Session) -> StackedVectors:
        entity, relation, known, seed = self.tensors(path, "entity", "relation", "known", "seed")
        checks.seeds_are(path, seed, self._seeds, entity, relation, known)
        rows = np.flatnonzero(np.isin(seed, points.seeds))
        theta = StackedVectors(family, entity[rows], relation[rows])
        checks.vectors_fit(path, theta, known[rows], session)
        return theta

    def initial_vectors(self, initializer: str, points: GridPoints) -> np.ndarray:
        """What an initializer inserted in the first session of a stack of grid points; shape (M, size, d)."""
        path, name = paths.initial_vectors(self.experiment, initializer), f"size={points.size:02d}"
        (vectors,) = self.tensors(path, name)
        dimension = io.shape_of(paths.theta0(self.experiment, points.size), "entity")[-1:]
        checks.has_shape(path, name, vectors, (len(self._seeds), points.sessions * points.size, *dimension))
        return vectors[np.isin(self._seeds, points.seeds), : points.size]

    @cached_property
    def _seeds(self) -> list[int]:
        """Of the sessions of every size."""
        return sorted(self.novel()["seed"].unique().tolist())

    def grid(self, stack: int, size: int | None = None, seeds: int | None = None) -> list[GridPoints]:
        """Every point of the grid, in stacks of at most ``stack`` seeds of one size.

        Args:
            size: of one size alone.
            seeds: of the first so many seeds alone.
        """
        graph, splits, novel = self.graph(), self.splits(), self.novel()
        self._check_sessions(graph, splits, novel)
        if size is not None:
            novel = novel[novel["size"] == size]
        if seeds is not None:
            novel = novel[novel["seed"] < seeds]
        if size is not None and novel.empty:
            raise InputError(paths.novel(self.experiment), "column 'size'", f"no set of {size} was drawn (params.yaml)")
        return [
            GridPoints(self.experiment, graph, size, seeds, np.stack([splits[seed] for seed in seeds]), drawn)
            for size, seeds, drawn in _stacks(novel, stack)
        ]

    def _check_sessions(self, graph: Graph, splits: dict[int, np.ndarray], novel: pd.DataFrame) -> None:
        path, drawn = paths.splits(self.experiment), paths.novel(self.experiment)
        checks.ids_below(drawn, novel, "entity", len(graph.entities), "graph's entities")
        checks.sets_are_whole(drawn, novel)
        if not set(novel["seed"]) <= set(splits):
            raise InputError(drawn, "column 'seed'", "expected seeds that have splits")
        checks.splits_are_whole(path, splits, graph, self.entities()["source"].to_numpy(str), novel)
        checks.every_split_is_there(path, splits)
        checks.everyone_is_trained(path, splits, graph)

    def insert_triples_of(self, points: GridPoints, table: pd.DataFrame) -> np.ndarray:
        """(session, model, place in ``novel``, triple) of the insert triples of some grid points; shape (I, 4)."""
        own = table[(table["size"] == points.size) & table["seed"].isin(points.seeds)]
        model = own["seed"].map({seed: number for number, seed in enumerate(points.seeds)}).to_numpy(np.int64)
        session = own["session"].to_numpy(np.int64)
        place = (points.novel[model, session - 1] == own["entity"].to_numpy()[:, None]).argmax(1)
        rows = np.stack([session, model, place, own["triple"].to_numpy(np.int64)], 1)
        return rows[np.lexsort(rows.T[::-1])]

    def write_runs(self, name: str, runs: pd.DataFrame) -> None:
        """Write the measures of a model at every epoch, and its ties at epoch 0."""
        ordered = runs.sort_values(["size", "seed", "session", "epoch", "scope"])
        at_once = ordered[ordered["epoch"] == 0]
        io.write(paths.ties(self.experiment, name), at_once, catalogue.TIES, self.provenance)
        io.write(paths.runs(self.experiment, name), ordered, catalogue.RUNS, self.provenance)

    def write_log(self, model: str, log: pd.DataFrame) -> None:
        """Write the looks at validation MRR* that training took."""
        ordered = log.sort_values(["size", "seed", "epoch"])
        io.write(paths.training_log(self.experiment, model), ordered, catalogue.TRAINING_LOG, self.provenance)


def _stacks(novel: pd.DataFrame, stack: int) -> Iterator[tuple[int, list[int], np.ndarray]]:
    """Size, seeds and novel entities (M, S, size) of each stack of points."""
    for size in sorted(novel["size"].unique().tolist()):
        rows = novel[novel["size"] == size]
        seeds = rows["seed"].unique().tolist()
        drawn = rows["entity"].to_numpy(np.int64).reshape(len(seeds), -1, size)
        for first in range(0, len(seeds), stack):
            yield size, seeds[first : first + stack], drawn[first : first + stack]
