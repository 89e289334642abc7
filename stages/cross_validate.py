"""For every fold and each of several settings, train a joint model on the other folds,
and measure it on the fold (section 5.3).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import pandas as pd
from pydantic import Field

from isi.config import Count, NotNegative, Positive, Section, Study
from isi.errors import InputError
from isi.evaluation.ranking import MEASURES
from isi.graph.graph import Graph
from isi.graph.sessions import VALID, folds
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, REAL, SHARE, at_least
from isi.tables.table import Table
from isi.training.fit import TrainConfig
from stages.grid import GridPoints
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store
from stages.train_theta0 import TrainResult, train_config, train_stack

RATE = at_least(0, REAL.type)
#: Measures of each setting on each held-out fold, at the best epoch (section 5.3).
CROSS_VALIDATION = Table(
    "data/analyses/cross_validation/{experiment}.parquet",
    {
        "dimension": FROM_1,
        "ratio": FROM_1,
        "learning_rate": RATE,
        "weight_decay": RATE,
        "fold": FROM_0,
        **dict.fromkeys(MEASURES, SHARE),
        "epoch": FROM_1,
    },
    key=["dimension", "ratio", "learning_rate", "weight_decay", "fold"],
    ordered=True,
)


class Setting(Section):
    """Training options that cross-validation varies."""

    dimension: Count
    ratio: Count
    learning_rate: Positive
    weight_decay: NotNegative


class CrossValidation(Study):
    """``cross_validation`` in params: the number of folds,
    and for each factor the values to try.
    """

    folds: Annotated[int, Field(ge=2)]
    dimension: list[Count]
    ratio: list[Count]
    learning_rate: list[Positive]
    weight_decay: list[NotNegative]

    def settings(self, choice: Setting) -> list[Setting]:
        """``choice``, then a copy of it for each factor and listed value,
        which differs in that factor.
        """
        changes = [
            {factor: value} for factor in Setting.model_fields for value in getattr(self, factor)
        ]
        return list(
            dict.fromkeys([choice, *(choice.model_copy(update=change) for change in changes)])
        )


def setting_of(config: TrainConfig) -> Setting:
    """The options of a configuration that cross-validation varies."""
    return Setting(
        dimension=config.dimension,
        ratio=config.negatives.ratio,
        learning_rate=config.training.learning_rate,
        weight_decay=config.training.weight_decay,
    )


@stage
def cross_validate(context: StageContext, experiment: str) -> None:
    params, graph = context.params.of(experiment), Store(experiment).graph()
    config, compute = train_config(params), params.read("compute", Compute)
    validation: CrossValidation = params.read("cross_validation", CrossValidation)
    grid = fold_points(experiment, graph, params.seed, validation.folds, stack_height(compute))
    settings = validation.settings(setting_of(config))
    cases = [(points, setting) for setting in settings for points in grid]
    tasks = [(points, changed_config(config, setting)) for points, setting in cases]
    trained = run(train_stack, tasks, compute, "cross-validation")
    best = pd.concat(
        best_validations(result, setting)
        for (_, setting), result in zip(cases, trained, strict=True)
    )
    CROSS_VALIDATION.write(best, context.stage, experiment=experiment)


def fold_points(
    experiment: str, graph: Graph, root: int, number: int, stack: int
) -> list[GridPoints]:
    """A model per fold, ≤ ``stack`` in a stack; fold i validates the model of seed i.
    InputError if a fold is empty.
    """
    splits = folds(graph, root, number)
    if not (splits == VALID).any(1).all():
        expected = (
            "expected fewer folds: one is empty, since each entity and "
            "relation keeps a training triple"
        )
        raise InputError(paths.PARAMS, "cross_validation.folds", expected)
    numbers = [list(range(first, min(first + stack, number))) for first in range(0, number, stack)]
    return [GridPoints.without_insertion(experiment, graph, part, splits[part]) for part in numbers]


def changed_config(choice: TrainConfig, setting: Setting) -> TrainConfig:
    """The configuration ``choice`` with the options of a setting."""
    negatives = choice.negatives.model_copy(update=setting.model_dump(include={"ratio"}))
    training = choice.training.model_copy(
        update=setting.model_dump(include={"learning_rate", "weight_decay"})
    )
    return replace(choice, dimension=setting.dimension, negatives=negatives, training=training)


def best_validations(trained: TrainResult, setting: Setting) -> pd.DataFrame:
    """Rows of ``CROSS_VALIDATION`` for the folds of a stack:
    validation measures at the best epoch.
    """
    best = trained.log[trained.log["kept"]].groupby("seed").last().rename_axis("fold").reset_index()
    return best.assign(**setting.model_dump())


if __name__ == "__main__":
    cross_validate()
