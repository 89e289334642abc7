"""The files of an experiment: the tables of training, insertion and measures,
and a store that reads them for tasks.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd
import torch

from isi.errors import InputError
from isi.evaluation.ranking import MEASURES
from isi.experiment.grid import GridPoints
from isi.graph.graph import ENTITIES, TRIPLES, Graph, GraphTables, build_graph
from isi.graph.sessions import (
    INSERT_TRIPLES,
    NOVEL,
    OUT,
    SPLIT_NAMES,
    SPLITS,
    SessionsOf,
    Shares,
    session_tables,
)
from isi.graph.words import WORD_VECTORS, Words, load_vectors, look_up
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, ColumnType, null_without, one_of
from isi.tables.table import DataFile, Table, TensorFile

SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")
#: Methods for entities without the data that their initializer needs.
FALLBACK_NAMES = ("es", "rs", "centroid")

#: Columns of measures, null without queries; of a grid point; and of a session.
MEASURE_COLUMNS = dict.fromkeys(MEASURES, SHARE.optional)
SIZE_AND_SEED = {"size": FROM_1, "seed": FROM_0}
SESSION = {"session": FROM_1}


def runs_table(template: str, by: Mapping[str, ColumnType] | None = None) -> Table:
    """A table of measures by epoch; the columns ``by`` distinguish runs of one grid point."""
    return Table(
        template,
        {
            **(by or {}),
            **SIZE_AND_SEED,
            "epoch": FROM_0,
            "scope": one_of(*SCOPES),
            **MEASURE_COLUMNS,
            "queries": FROM_0,
            **SESSION,
        },
        key=[*(by or {}), "size", "seed", "session", "epoch", "scope"],
        ordered=True,
        checks=[null_without("queries", *MEASURES)],
    )


#: For S seeds: ``entity`` (S, E, d), ``relation`` (S, R, w), ``known`` (S, E), ``seed`` (S,); zeros
#: unless known.
THETA0 = TensorFile("data/embeddings/{experiment}/theta0/size={size:02d}.safetensors")
#: The same tensors, by session (``GridPoints.joint_prefix``); ``known``: entities of that session.
JOINT = TensorFile("data/embeddings/{experiment}/joint.safetensors")
#: Validation measures of ``model``, theta0 or joint (size 0), during training; ``kept``: MRR* is
#: the best so far.
TRAINING_LOG = Table(
    "data/embeddings/{experiment}/{model}.log.parquet",
    {
        "size": FROM_0,
        "seed": FROM_0,
        "epoch": FROM_1,
        **MEASURE_COLUMNS,
        "kept": ColumnType("bool"),
    },
    key=["size", "seed", "epoch"],
    ordered=True,
)
#: Measures of an initializer or of the joint model. ``queries`` counts triples; each triple gives
#: three queries.
RUNS = runs_table("data/runs/{experiment}/{model}.parquet")
#: Vectors of the novel entities before training: tensors ``size=NN``, shape (S, n, d), in the order
#: of ``NOVEL``.
INITIAL_VECTORS = TensorFile("data/runs/{experiment}/{initializer}.safetensors")
#: One row per inserted entity: measures of its own queries of scope ``novel`` at epoch 0, and its
#: fallback.
INSERTED = Table(
    "data/runs/{experiment}/{initializer}.inserted.parquet",
    {
        **SIZE_AND_SEED,
        "entity": FROM_0,
        "kind": NAME,
        "fallback": one_of(*FALLBACK_NAMES).optional,
        **MEASURE_COLUMNS,
        "queries": FROM_0,
        "ties": FROM_0,
        **SESSION,
    },
    key=["size", "seed", "session", "entity"],
    ordered=True,
    checks=[null_without("queries", *MEASURES)],
)
#: Number of candidates whose score is tied with the answer's, summed over queries, at epoch 0.
TIES = Table(
    "data/runs/{experiment}/{model}.ties.parquet",
    {**SIZE_AND_SEED, "scope": one_of(*SCOPES), "ties": FROM_0, **SESSION},
    key=["size", "seed", "session", "scope"],
    ordered=True,
)


def write_runs(runs: pd.DataFrame, stage: str, experiment: str, model: str) -> None:
    """Write the measures of a model at every epoch, and its ties at epoch 0."""
    TIES.write(runs[runs["epoch"] == 0], stage, experiment=experiment, model=model)
    RUNS.write(runs, stage, experiment=experiment, model=model)


@dataclass(frozen=True)
class Store:
    """Reads the files of one experiment, each table once."""

    experiment: str
    #: those in memory are not read
    tables: dict[Table, pd.DataFrame] = field(default_factory=dict, repr=False)
    #: word vectors in memory; shape: (E, w)
    vectors: np.ndarray | None = field(default=None, repr=False)

    @classmethod
    def drawn(
        cls,
        name: str,
        tables: GraphTables,
        words: Words,
        sessions: SessionsOf,
        shares: Shares,
        root: int,
        key: str,
    ) -> Self:
        """A store in memory of a graph, its word vectors and its sessions,
        whose params lie at ``key``.
        """
        vectors = look_up(load_vectors(words), list(tables.entities["phrase"]))
        graph = build_graph(tables.entities, tables.triples)
        rows = session_tables(graph, tables.entities, sessions, shares, root, f"{key}.sessions")
        with_words = len(tables.entities) - vectors.served_by.count(None)
        print(
            tables, f"{with_words} of {len(tables.entities)} entities have a word vector", sep="\n"
        )
        return cls(
            name, {ENTITIES: tables.entities, TRIPLES: tables.triples, **rows}, vectors.vectors
        )

    def table(self, table: Table) -> pd.DataFrame:
        """A table of the experiment."""
        if table not in self.tables:
            self.tables[table] = table.read(experiment=self.experiment)
        return self.tables[table]

    def entities(self) -> pd.DataFrame:
        return self.table(ENTITIES)

    def graph(self) -> Graph:
        return build_graph(self.entities(), self.table(TRIPLES), self._path(TRIPLES))

    def words(self) -> np.ndarray:
        """Word vectors of the entities; shape: (E, w)."""
        if self.vectors is not None:
            return self.vectors
        (vectors,) = self._arrays(WORD_VECTORS, "vectors")
        return vectors

    def splits(self) -> dict[int, np.ndarray]:
        """The split of each unique triple by seed, ``OUT`` for none; shapes: (T,), int8."""
        table, triples = self.table(SPLITS), len(self.table(TRIPLES))
        codes = (
            table["split"]
            .astype(str)
            .map({name: number for number, name in enumerate(SPLIT_NAMES)})
        )
        splits = {
            seed: np.full(triples, OUT, dtype=np.int8)
            for seed in sorted(table["seed"].unique().tolist())
        }
        for seed, rows in table.assign(code=codes.astype(np.int8)).groupby("seed"):
            splits[seed][rows["triple"]] = rows["code"]
        return splits

    def grid(
        self, stack: int, size: int | None = None, seeds: int | None = None
    ) -> list[GridPoints]:
        """Grid points of ``size`` and the first ``seeds`` (None: all),
        in stacks of at most ``stack`` seeds each.
        """
        graph = self.graph()
        splits = self.splits()
        novel = self.table(NOVEL)
        chosen = novel if size is None else novel[novel["size"] == size]
        chosen = chosen if seeds is None else chosen[chosen["seed"] < seeds]
        if chosen.empty:
            raise InputError(
                self._path(NOVEL),
                "column 'size'",
                f"expected rows of size {size} and seed below {seeds} (None: any)",
            )
        given, grid = self.table(INSERT_TRIPLES), []
        for number in sorted(set(chosen["size"].tolist())):
            of_size = chosen[chosen["size"] == number]
            numbers = of_size["seed"].unique().tolist()
            for part in (numbers[first : first + stack] for first in range(0, len(numbers), stack)):
                rows = of_size[of_size["seed"].isin(part)]
                drawn = rows["entity"].to_numpy(np.int64, copy=True).reshape(len(part), -1, number)
                place = rows.groupby(["seed", "session"]).cumcount()
                rows = rows.assign(model=rows["seed"].map(part.index), place=place)
                joined = given.merge(rows, on=["size", "seed", "session", "entity"])
                triples = joined[["session", "model", "place", "triple"]].to_numpy(np.int64)
                triples = triples[np.lexsort(triples.T[::-1])]
                codes = np.stack([splits[seed] for seed in part])
                grid.append(GridPoints(self.experiment, graph, number, part, codes, drawn, triples))
        return grid

    @property
    def _seeds(self) -> list[int]:
        return sorted(self.table(NOVEL)["seed"].unique().tolist())

    def theta0(self, points: GridPoints, model: Model) -> Embedding:
        """Θ⁰ of a stack of grid points."""
        return self._embedding(THETA0, points, model, "")

    def joint(self, points: GridPoints, model: Model, session: int = 1) -> Embedding:
        """The joint models of a session of a stack of grid points."""
        return self._embedding(JOINT, points, model, points.joint_prefix(session))

    def joint_models(self, points: GridPoints, model: Model) -> list[Embedding]:
        """The joint models of every session of a stack of grid points."""
        return [self.joint(points, model, session) for session in range(1, points.sessions + 1)]

    def _embedding(
        self, file: TensorFile, points: GridPoints, model: Model, prefix: str
    ) -> Embedding:
        """The models of a session at a stack of grid points."""
        names = [f"{prefix}{name}" for name in ("entity", "relation", "seed")]
        *tensors, seed = self._arrays(file, *names, size=points.size)
        entity, relation = (tensor[np.isin(seed, points.seeds)] for tensor in tensors)
        return Embedding(torch.from_numpy(entity), torch.from_numpy(relation), model)

    def initial_vectors(self, initializer: str, points: GridPoints) -> np.ndarray:
        """The vectors that an initializer gave in session 1 at a stack of grid points;
        shape (M, size, d).
        """
        name = f"size={points.size:02d}"
        (vectors,) = self._arrays(INITIAL_VECTORS, name, initializer=initializer)
        return vectors[np.isin(self._seeds, points.seeds), : points.size]

    def _path(self, file: DataFile, **names: str | int) -> Path:
        return file.path(experiment=self.experiment, **names)

    def _arrays(self, file: TensorFile, *tensors: str, **names: str | int) -> list[np.ndarray]:
        return [
            tensor.numpy()
            for tensor in file.read(tensors, experiment=self.experiment, **names).values()
        ]
