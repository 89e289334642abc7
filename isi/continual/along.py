"""The steps of an embedding along a timeline: insertion, training and ranking at each snapshot."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from isi.continual.chain import Growth, chosen, first_embedding, grow
from isi.continual.matrix import evaluate
from isi.continual.strategies import Schedule
from isi.continual.timeline import Timeline
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.process import peak_memory, reset_peak_memory
from isi.training.rows import OnEpoch, silent

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Step:
    """What a chain has after one snapshot."""

    theta: Embedding  #: of the entities of snapshots 0 to i, in the packed form
    matrix: pd.DataFrame  #: row i of R, before and after the training (``evaluate``)
    costs: pd.DataFrame  #: ``snapshot``, ``phase``, ``seconds`` and ``peak_mib``


@dataclass(frozen=True, eq=False)
class Along:
    """What all steps along a timeline share."""

    timeline: Timeline
    schedule: Schedule
    words: np.ndarray | None = None  #: of all entities, (E, v)
    most: int | None = None  #: maximum number of test triples of a snapshot that are ranked
    on_epoch: OnEpoch = silent

    def first(self, model: Model, dimension: int, seed: int) -> Step:
        """Train an embedding of snapshot 0 from random vectors, and rank its test set."""
        reset_peak_memory()
        begun = time.process_time()
        theta = first_embedding(
            self.timeline, model, dimension, self.schedule, seed, on_epoch=self.on_epoch
        )
        return self.start_from(theta, time.process_time() - begun)

    def start_from(self, theta: Embedding, seconds: float = 0.0) -> Step:
        """The step of an embedding of snapshot 0 that has been trained."""
        cost = {"phase": "trained", "seconds": seconds, "peak_mib": peak_memory()}
        return self._step(0, theta, [evaluate(theta, self.timeline, 0, most=self.most)], [cost])

    def chosen(self, first: Embedding, growth: Growth, seed: int) -> tuple[Growth, float]:
        """The growth with an initializer (``isi.continual.chain.chosen``), and the seconds that its
        choice took.
        """
        begun = time.process_time()
        growth = chosen(self.timeline, first, growth, self.words, seed)
        return growth, time.process_time() - begun

    def next(
        self, before: Embedding, growth: Growth, snapshot: int, seed: int, seconds: float = 0.0
    ) -> Step:
        """Insert the entities of a snapshot into the embedding before it, and train; rank the test
        sets of all snapshots so far after both. ``seconds`` were spent on the choice of the
        initializer.
        """
        chain = grow(
            self.timeline,
            before,
            growth,
            self.schedule,
            start=snapshot,
            words=self.words,
            seed=seed,
            on_epoch=self.on_epoch,
        )
        theta = before
        rows: list[pd.DataFrame] = []
        costs: list[dict[str, Any]] = []
        reset_peak_memory()
        for grown in islice(chain, 2):
            theta = grown.theta
            took = grown.seconds + (seconds if grown.phase == "inserted" else 0.0)
            cost = {"phase": grown.phase, "seconds": took, "peak_mib": peak_memory()}
            costs.append(cost)
            rows.append(evaluate(theta, self.timeline, snapshot, phase=grown.phase, most=self.most))
            reset_peak_memory()
        return self._step(snapshot, theta, rows, costs)

    @staticmethod
    def _step(
        snapshot: int, theta: Embedding, rows: list[pd.DataFrame], costs: list[dict[str, Any]]
    ) -> Step:
        import pandas as pd

        matrix = pd.concat(rows, ignore_index=True)
        return Step(theta, matrix, pd.DataFrame(costs).assign(snapshot=snapshot))
