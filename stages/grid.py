"""The grid of insertions: a grid point is a size and a seed; a task has a stack of grid points of
one size.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.config import Count, EachOnce, Names, Section, Seed, Study
from isi.evaluation.changes import changed_query_sets
from isi.evaluation.query_sets import query_sets, triples_of_groups
from isi.evaluation.ranking import Queries
from isi.graph.graph import Graph
from isi.graph.sessions import Session, session_at

NO_INSERTION = 0  #: Size of grid points without insertion, in keys of random streams and in logs.
JOINT_MODEL = "joint"  #: Name of the joint model in tables and paths, in place of an initializer's.


InitializerList = Annotated[Names, Field(min_length=1)] | Literal["all"]  #: Of an experiment.
#: ``full_curves`` of an experiment: sizes that are fine-tuned for all epochs, for the learning
#: curves; the others until they converge.
FullCurves = Annotated[list[Count], EachOnce]


def is_listed(names: InitializerList, initializer: str) -> bool:
    """Whether ``names`` has the initializer or is "all"."""
    return names == "all" or initializer in names


class Finetuned(Section):
    """``finetuned`` of an experiment: initializers that are fine-tuned after insertion, and in how
    many of the seeds, the first ones; the others are measured right after insertion alone.
    """

    initializers: InitializerList
    seeds: Count


class NovelSet(Study):
    """``explorer`` in params, and part of ``trajectory``: |ξ| and seed of a novel set."""

    size: Count
    seed: Seed


@dataclass(frozen=True)
class GridPoints:
    """Grid points of one size, over one graph."""

    experiment: str
    graph: Graph
    size: int
    seeds: list[int]
    splits: np.ndarray  #: of each seed; shape: (M, T), int8
    novel: np.ndarray  #: ids of the novel entities; shape: (M, size)
    #: rows (model, place in ``novel``, triple id), ascending; shape: (I, 3)
    insert_triples: np.ndarray = field(default_factory=lambda: np.empty((0, 3), np.int64))

    @classmethod
    def without_insertion(
        cls, experiment: str, graph: Graph, seeds: list[int], splits: np.ndarray
    ) -> GridPoints:
        """Grid points at which every entity is known from the start."""
        novel = np.empty((len(seeds), 0), dtype=np.int64)
        return cls(experiment, graph, NO_INSERTION, seeds, splits, novel)

    def __str__(self) -> str:
        return f"{self.experiment}, size {self.size}, seeds {', '.join(map(str, self.seeds))}"

    @property
    def all_known(self) -> GridPoints:
        """The same seeds with nothing to insert: D⁰ equals D¹."""
        return self.without_insertion(self.experiment, self.graph, self.seeds, self.splits)

    def keys(self) -> Tensor:
        """Size and seed of each model, as keys of its random streams; shape: (M, 2)."""
        return torch.tensor([[self.size, seed] for seed in self.seeds])

    def session(self, number: int) -> Session:
        """D⁰ or D¹."""
        return session_at(self.graph, torch.as_tensor(self.splits), self.novel_ids, number)

    @property
    def novel_ids(self) -> Tensor:
        """``novel`` as a tensor; shape: (M, size)."""
        return torch.as_tensor(self.novel)

    @property
    def insert_mask(self) -> Tensor:
        """The insert triples as a mask; shape: (M, T)."""
        mask = torch.zeros(self.splits.shape, dtype=torch.bool)
        mask[self.insert_triples[:, 0], self.insert_triples[:, 2]] = True
        return mask

    def measured_sets(self, with_changes: bool) -> list[dict[str, Queries]]:
        """The query sets of D¹, and those of changes of the measure."""
        arguments = self.session(1), self.novel_ids, self.insert_mask
        changed = [changed_query_sets(*arguments)] if with_changes else []
        return [query_sets(*arguments), *changed]

    def run_rows(self, looks: Iterable[pd.DataFrame]) -> pd.DataFrame:
        """Rows of measures with size and seed (``RUNS``), from measures by place in the stack."""
        rows = pd.concat(looks, ignore_index=True)
        seeds = np.array(self.seeds)[rows["place"]]
        return rows.drop(columns="place").assign(size=self.size, seed=seeds)


def known_shares(grid: Iterable[GridPoints]) -> dict[int, float]:
    """The weight w of the group *known* in *weighted*, by size: the mean number of test triples
    between known entities over the sets, against that of unique triples with a novel entity.
    """
    known, novel = dict[int, int](), dict[int, int]()
    for points in grid:
        of_known, of_novel = triples_of_groups(points.session(1), points.novel_ids)
        known[points.size] = known.get(points.size, 0) + int(of_known.sum())
        novel[points.size] = novel.get(points.size, 0) + int(of_novel.sum())
    return {size: known[size] / (known[size] + novel[size]) for size in known}
