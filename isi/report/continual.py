"""Runs of the third pipeline as the report reads them: embeddings that are carried along a graph
that grows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import pandas as pd

from isi.continual.experiment import COSTS, DEFAULT, FAULTS, MATRIX, ContinualExperiment
from isi.continual.matrix import pooled
from isi.continual.measures import (
    historical,
    mean_after_last,
    new_answers,
    score_matrix,
)
from isi.report.stats import over_seeds, where
from isi.report.words import label

CHAIN = ["initializer", "strategy"]  #: Columns that name chains of several seeds.
#: Measures of ``ContinualRuns.measures``, with their factors and headers in files.
MEASURES = {
    "at_once": (100, "new tests, at once"),
    "trained": (100, "new tests, after training"),
    "base_before": (100, "base test, before"),
    "base": (100, "base test, in the end"),
    "interference": (100, "D"),
    "seconds": (1, "seconds"),
}


@dataclass(frozen=True, eq=False)
class ContinualRuns:
    """The tables of one experiment."""

    name: str  #: its key in params
    settings: ContinualExperiment
    matrix: pd.DataFrame
    costs: pd.DataFrame
    faults: pd.DataFrame

    @classmethod
    def read(cls, name: str, settings: ContinualExperiment) -> Self:
        """The tables of an experiment, with plain strings."""
        tables = (table.read_text(experiment=name) for table in (MATRIX, COSTS, FAULTS))
        return cls(name, settings, *tables)

    @property
    def title(self) -> str:
        return self.settings.title

    def name_of(self, key: str) -> str:
        """The display name of an initializer of params, or of the choice among them."""
        initializer, options = self.settings.initializer_of(key)
        if key == DEFAULT:
            return DEFAULT
        if key == initializer:
            return label(key)
        return ", ".join([label(initializer), *(f"{name} {options[name]}" for name in options)])

    @property
    def model(self) -> str:
        """The model and its dimension."""
        return f"{self.settings.model}, d = {self.settings.dimension}"

    @property
    def chains(self) -> list[tuple[str, str]]:
        """Initializers with strategies, in the order of params."""
        return [
            (initializer, strategy)
            for initializer in self.settings.initializers
            for strategy in self.settings.strategies_of(initializer)
        ]

    @property
    def snapshots(self) -> int:
        """Number of snapshots."""
        return int(self.matrix["i"].max()) + 1

    def frame(self, initializer: str, strategy: str, seed: int) -> pd.DataFrame:
        """The rows of a chain, the first embedding's included, in the columns of ``evaluate``."""
        of_seed = where(self.matrix, seed=seed)
        is_chain = (of_seed["initializer"] == initializer) & (of_seed["strategy"] == strategy)
        return of_seed[is_chain | (of_seed["i"] == 0)]

    def frames(self) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
        """The rows of each chain, with its columns."""
        for initializer, strategy in self.chains:
            for seed in range(self.settings.seeds):
                columns = {"initializer": initializer, "strategy": strategy, "seed": seed}
                yield columns, self.frame(initializer, strategy, seed)

    @cached_property
    def measures(self) -> pd.DataFrame:
        """``MEASURES`` with their intervals over seeds; a row for each of ``chains``."""
        rows = [columns | _measures(frame) for columns, frame in self.frames()]
        seconds = self.costs.groupby([*CHAIN, "seed"])["seconds"].sum().rename("seconds")
        table = pd.DataFrame(rows).join(seconds, on=[*CHAIN, "seed"])
        columns = [
            over_seeds(table, CHAIN, {name: header}, scale)
            for name, (scale, header) in MEASURES.items()
        ]
        return pd.concat(columns, axis=1).reindex(self.chains)

    def published(self, protocol: str) -> pd.DataFrame:
        """Mean MRR, hits@1 and hits@10 of all test sets after the last snapshot, points."""
        rows = []
        for columns, frame in self.frames():
            values = {
                name: mean_after_last(score_matrix(frame, protocol, name))
                for name in ("mrr", "hits@1", "hits@10")
            }
            rows.append(columns | values)
        names = {name: name for name in ("mrr", "hits@1", "hits@10")}
        return over_seeds(pd.DataFrame(rows), CHAIN, names).reindex(self.chains)

    def interference(self) -> pd.DataFrame:
        """MEOR's H_cur, H_old, D and A_TN after training, points."""
        rows = []
        for columns, frame in self.frames():
            h_cur, h_old = (historical(frame, name) for name in ("current", "old"))
            values = {"H_cur": h_cur, "H_old": h_old, "D": h_old - h_cur}
            rows.append(columns | values | {"A_TN": new_answers(frame)})
        names = {name: name for name in ("H_cur", "H_old", "D", "A_TN")}
        return over_seeds(pd.DataFrame(rows), CHAIN, names).reindex(self.chains)

    def score_matrix(self, initializer: str, strategy: str) -> np.ndarray:
        """R[i, j] under the protocol ``current``, points, mean over seeds; shape (T, T)."""
        seeds = range(self.settings.seeds)
        frames = [self.frame(initializer, strategy, seed) for seed in seeds]
        mean: np.ndarray = np.mean([score_matrix(frame, "current") for frame in frames], 0)
        return 100 * mean


def _measures(frame: pd.DataFrame) -> dict[str, float]:
    """``MEASURES`` of one chain, but for ``seconds``."""
    current = where(frame, protocol="current")
    new = current[(current["i"] == current["j"]) & (current["i"] > 0)]
    by_phase = pooled(new, ["phase"]).set_index("phase")["mrr"]
    base = score_matrix(frame, "current")[:, 0]
    h_old, h_cur = (historical(frame, name) for name in ("old", "current"))
    return {
        "at_once": by_phase.get("inserted", np.nan),
        "trained": by_phase.get("trained", np.nan),
        "base_before": base[0],
        "base": base[-1],
        "interference": h_old - h_cur,
    }


def read(experiments: Mapping[str, ContinualExperiment]) -> list[ContinualRuns]:
    """The experiments that were run."""
    return [
        ContinualRuns.read(name, settings)
        for name, settings in experiments.items()
        if FAULTS.path(experiment=name).exists()
    ]
