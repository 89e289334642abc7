"""The files of an experiment, read for tasks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from isi.errors import InputError
from isi.evaluation.changes import CHANGES
from isi.evaluation.ranking import MEASURES
from isi.evaluation.scopes import GROUPS, SCOPES
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import OUT
from isi.models.model import Model, make_model
from isi.models.stack import Embedding
from isi.tables.rules import FROM_0, FROM_1, SHARE, ColumnType, null_without, one_of, refuse
from isi.tables.table import DataFile, Table, TensorFile
from stages.files import (
    ENTITIES,
    INSERT_TRIPLES,
    NOVEL,
    SPLIT_NAMES,
    SPLITS,
    TRIPLES,
    WORD_VECTORS,
)
from stages.grid import GridPoints
from stages.params import StageParams

#: Columns of measures, null without queries; and of a grid point.
MEASURE_COLUMNS = dict.fromkeys(MEASURES, SHARE.optional)
SIZE_AND_SEED = {"size": FROM_1, "seed": FROM_0}


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
        },
        key=[*(by or {}), "size", "seed", "epoch", "scope"],
        ordered=True,
        checks=[null_without("queries", *MEASURES)],
    )


#: For S seeds: ``entity`` (S, E, d), ``relation`` (S, R, w), ``known`` (S, E), ``seed`` (S,); zeros
#: unless known.
THETA0 = TensorFile("data/embeddings/{experiment}/theta0/size={size:02d}.safetensors")
#: The same tensors of D¹; ``known``: its entities.
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
#: The measure, and each change of it (``isi.evaluation.changes``). One group: scope ``weighted``.
MEASURE_CHANGES = Table(
    "data/analyses/measure/{experiment}/{model}.parquet",
    {
        **SIZE_AND_SEED,
        "epoch": FROM_0,
        "change": one_of(*CHANGES),
        "scope": one_of(*GROUPS, "weighted"),
        "value": SHARE.optional,
    },
    key=["size", "seed", "epoch", "change", "scope"],
    ordered=True,
)
_ROWS = "expected a row of each entity"


def model_of(params: StageParams, name: str | None = None) -> Model:
    """The model ``name`` (None: ``embedding.model``), with its options."""
    name = name or params.read("embedding.model", str)
    key = f"models.{name}"
    return make_model(name, params.read(key, dict[str, Any]), key)


@dataclass(frozen=True)
class Store:
    """Reads the files of one experiment, each table once."""

    experiment: str
    #: those in memory are not read
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

    def graph(self) -> Graph:
        return build_graph(self.entities(), self.table(TRIPLES), self._path(TRIPLES))

    def words(self) -> np.ndarray:
        """Word vectors of the entities; shape: (E, w)."""
        if self.vectors is not None:
            return self.vectors
        (vectors,) = self._arrays(WORD_VECTORS, "vectors")
        if len(vectors) != len(self.entities()):
            raise InputError(self._path(WORD_VECTORS), "tensor 'vectors'", _ROWS)
        return vectors

    def check_sessions(self) -> None:
        """InputError for the first row of sessions that names a triple, an entity or a seed that
        another table lacks: an edited table may be committed to DVC.
        """
        splits, novel, facts = (self.table(each) for each in (SPLITS, NOVEL, INSERT_TRIPLES))
        entities, triples = len(self.entities()), len(self.table(TRIPLES))
        key = ["size", "seed", "entity"]
        of_set = novel.groupby(["size", "seed"])["entity"].transform("size")
        is_novel = pd.MultiIndex.from_frame(facts[key]).isin(pd.MultiIndex.from_frame(novel[key]))
        known_seed = novel["seed"].isin(splits["seed"])
        for table, wrong, columns, expected in (
            (SPLITS, splits["triple"] >= triples, ["triple"], "a row number of triples"),
            (NOVEL, novel["entity"] >= entities, ["entity"], "a row number of entities"),
            (NOVEL, ~known_seed, ["seed"], "a seed of splits"),
            (NOVEL, of_set != novel["size"], key, "as many entities in a set as its size"),
            (
                INSERT_TRIPLES,
                facts["triple"] >= triples,
                ["triple"],
                "a row number of triples",
            ),
            (INSERT_TRIPLES, ~is_novel, key, "an entity of this set in novel"),
        ):
            refuse(self._path(table), self.table(table), wrong, columns, f"expected {expected}")

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
        self.check_sessions()
        graph, splits, novel = self.graph(), self.splits(), self.table(NOVEL)
        chosen = novel if size is None else novel[novel["size"] == size]
        chosen = chosen if seeds is None else chosen[chosen["seed"] < seeds]
        if chosen.empty:
            raise InputError(
                self._path(NOVEL),
                "column 'size'",
                f"expected rows of size {size} and seed below {seeds} (None: any)",
            )
        insert_triples, grid = self.table(INSERT_TRIPLES), list[GridPoints]()
        for number in sorted(set(chosen["size"].tolist())):
            of_size = chosen[chosen["size"] == number]
            numbers = of_size["seed"].unique().tolist()
            for part in (numbers[first : first + stack] for first in range(0, len(numbers), stack)):
                rows = of_size[of_size["seed"].isin(part)]
                drawn = rows["entity"].to_numpy(np.int64, copy=True).reshape(len(part), number)
                place = rows.groupby("seed").cumcount()
                rows = rows.assign(model=rows["seed"].map(part.index), place=place)
                joined = insert_triples.merge(rows, on=["size", "seed", "entity"])
                triples = joined[["model", "place", "triple"]].to_numpy(np.int64)
                triples = triples[np.lexsort(triples.T[::-1])]
                codes = np.stack([splits[seed] for seed in part])
                grid.append(GridPoints(self.experiment, graph, number, part, codes, drawn, triples))
        return grid

    @property
    def _seeds(self) -> list[int]:
        return sorted(self.table(NOVEL)["seed"].unique().tolist())

    def theta0(self, points: GridPoints, model: Model) -> Embedding:
        """Θ⁰ of a stack of grid points."""
        entity, relation, seed = self._embeddings(THETA0, points.seeds, size=points.size)
        chosen = np.isin(seed, points.seeds)
        tables = torch.from_numpy(entity[chosen]), torch.from_numpy(relation[chosen])
        return Embedding(*tables, model)

    def joint(self, points: GridPoints, model: Model) -> list[Embedding]:
        """The joint models of a stack of grid points: one of each seed, or, where all seeds share
        a few, each of these for all.
        """
        seeds = [] if self.shares_split else points.seeds
        entity, relation, seed = self._embeddings(JOINT, seeds)
        if self.shares_split:
            places = [np.full(len(points.seeds), place) for place in range(len(seed))]
        else:
            places = [np.flatnonzero(np.isin(seed, points.seeds))]
        return [
            Embedding(torch.from_numpy(entity[place]), torch.from_numpy(relation[place]), model)
            for place in places
        ]

    @property
    def shares_split(self) -> bool:
        """Whether all seeds have one D¹ with one split."""
        first, *others = self.splits().values()
        return bool(others) and all(np.array_equal(first, other) for other in others)

    def initial_vectors(self, initializer: str, points: GridPoints) -> np.ndarray:
        """The vectors that an initializer gave at a stack of grid points; shape (M, size, d)."""
        name = f"size={points.size:02d}"
        (vectors,) = self._arrays(INITIAL_VECTORS, name, initializer=initializer)
        if vectors.shape[:2] != (len(self._seeds), points.size):
            path = self._path(INITIAL_VECTORS, initializer=initializer)
            expected = "expected a vector of each novel entity of each seed"
            raise InputError(path, f"tensor {name!r}", expected)
        return vectors[np.isin(self._seeds, points.seeds)]

    def _embeddings(
        self, file: TensorFile, seeds: list[int], **names: str | int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tables of vectors with their seeds; an ``InputError`` where a seed or an entity lacks
        one.
        """
        entity, relation, seed = self._arrays(file, "entity", "relation", "seed", **names)
        path = self._path(file, **names)
        if missing := set(seeds) - set(seed.tolist()):
            raise InputError(path, "tensor 'seed'", f"expected seed {min(missing)}")
        if entity.shape[1] != len(self.entities()):
            raise InputError(path, "tensor 'entity'", _ROWS)
        return entity, relation, seed

    def _path(self, file: DataFile, **names: str | int) -> Path:
        return file.path(experiment=self.experiment, **names)

    def _arrays(self, file: TensorFile, *tensors: str, **names: str | int) -> list[np.ndarray]:
        return [
            tensor.numpy()
            for tensor in file.read(tensors, experiment=self.experiment, **names).values()
        ]
