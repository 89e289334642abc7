"""Cross-validation of how the joint model is trained (section 5.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import pandas as pd
from pydantic import Field

from isi.config import Count, NotNegative, Positive, Section, Study
from isi.evaluation.ranking import MEASURES
from isi.experiment.grid import GridPoints
from isi.experiment.tables import HALVES, MEASURE_COLUMNS
from isi.experiment.train import TrainConfig, TrainResult, TrainTask
from isi.graph.graph import Graph
from isi.graph.sampling import folds
from isi.tables.rules import at_least, within
from isi.tables.table import INT, REAL, Table

#: The best evaluation of each setting on each held-out fold.
CROSS_VALIDATION = Table(
    "data/analyses/cross_validation/{experiment}.parquet",
    {"dimension": INT, "ratio": INT, "learning_rate": REAL, "weight_decay": REAL, "fold": INT, **MEASURE_COLUMNS,
     "epoch": INT},
    key=["dimension", "ratio", "learning_rate", "weight_decay", "fold"],
    ordered=True,
    checks=[*at_least(1, "dimension", "ratio", "epoch"), *at_least(0, "learning_rate", "weight_decay", "fold"),
            *within(0, 1, *MEASURES), *HALVES],
)  # fmt: skip


class Setting(Section):
    """What cross-validation compares."""

    dimension: Count
    ratio: Count
    learning_rate: Positive
    weight_decay: NotNegative

    @classmethod
    def of(cls, how: TrainConfig) -> Setting:
        """The setting of some training."""
        return cls(
            dimension=how.dimension,
            ratio=how.negatives.ratio,
            learning_rate=how.training.learning_rate,
            weight_decay=how.training.weight_decay,
        )


class CrossValidation(Study):
    """``cross_validation`` in params: the values that each factor takes beside the choice."""

    folds: Annotated[int, Field(ge=2)]
    dimension: list[Count]
    ratio: list[Count]
    learning_rate: list[Positive]
    weight_decay: list[NotNegative]

    def settings(self, choice: Setting) -> list[Setting]:
        """The choice, then the choice with one factor at a time changed to each value listed."""
        changes = [{factor: value} for factor in Setting.model_fields for value in getattr(self, factor)]
        return list(dict.fromkeys([choice, *(choice.model_copy(update=change) for change in changes)]))


def fold_tasks(
    experiment: str, graph: Graph, study: CrossValidation, choice: TrainConfig, stack: int
) -> list[TrainTask]:
    """Every setting with every fold, in stacks of at most ``stack`` folds; the points' seeds are the folds' numbers."""
    splits = folds(graph, choice.root, study.folds)
    tasks = []
    for setting in study.settings(Setting.of(choice)):
        for first in range(0, len(splits), stack):
            stacked = splits[first : first + stack]
            numbers = list(range(first, first + len(stacked)))
            points = GridPoints.without_insertion(experiment, graph, numbers, stacked)
            tasks.append(TrainTask(points, changed(choice, setting)))
    return tasks


def changed(choice: TrainConfig, setting: Setting) -> TrainConfig:
    """The choice with another setting."""
    training = {"learning_rate": setting.learning_rate, "weight_decay": setting.weight_decay}
    return replace(
        choice,
        dimension=setting.dimension,
        negatives=choice.negatives.model_copy(update={"ratio": setting.ratio}),
        training=choice.training.model_copy(update=training),
    )


def best_looks(task: TrainTask, learned: TrainResult) -> pd.DataFrame:
    """The best look at each held-out fold (``CROSS_VALIDATION``)."""
    best = learned.log[learned.log["kept"]].groupby("seed").last().rename_axis("fold").reset_index()
    return best.assign(**Setting.of(task.config).model_dump())
