"""The joint model of every embedding family on one graph, as well trained as validation triples can tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
import torch

from isi.config import Count, Name, NotNegative, Positive, Section, Study
from isi.evaluation import query_sets
from isi.evaluation.ranking import MEASURES, evaluate
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.tables import HALVES, MEASURE_COLUMNS
from isi.experiment.train import TrainResult
from isi.tables.rules import at_least, measured, within
from isi.tables.table import INT, REAL, Table

#: Measures of the joint models of one scoring function.
MODEL_COMPARISON = Table(
    "data/analyses/models/{experiment}/{model}.parquet",
    {"seed": INT, "epochs": INT, **MEASURE_COLUMNS, "valid_mrr_star": REAL, "queries": INT},
    key=["seed"],
    checks=[*at_least(0, "seed"), *at_least(1, "epochs"), *within(0, 1, "valid_mrr_star"),
            *measured(MEASURES, "queries"), *HALVES],
    nullable=MEASURES,
)  # fmt: skip


class ModelTraining(Section):
    """How the joint model of an embedding model is trained."""

    learning_rate: Positive
    weight_decay: NotNegative


class ModelComparison(Study):
    """``compare_models`` in params."""

    renamed: ClassVar = {"families": "models"}
    seeds: Count
    models: dict[Name, ModelTraining]


@dataclass(frozen=True)
class ModelTask:
    """Measure joint models over all test triples."""

    points: GridPoints
    theta: StackedVectors


def measure(task: ModelTask) -> pd.DataFrame:
    """Measures in scope all, one row a seed."""
    points, nobody = task.points, torch.empty(len(task.points.seeds), 0, dtype=torch.int64)
    result = evaluate(task.theta.stack, query_sets.epoch_query_sets(points.last_session, nobody))["all"]
    columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
    return pd.DataFrame(columns | {"seed": points.seeds, "queries": result.queries.cpu().numpy()})


def rows(measured: pd.DataFrame, learned: TrainResult) -> pd.DataFrame:
    """With the epochs that training took and the validation MRR* that it kept (``MODEL_COMPARISON``)."""
    kept = learned.log[learned.log["kept"]].groupby("seed")["mrr_star"].last()
    epochs = learned.log.groupby("seed")["epoch"].max()
    seed = measured["seed"]
    return measured.assign(
        epochs=epochs.reindex(seed).to_numpy(np.int32), valid_mrr_star=kept.reindex(seed).to_numpy(float)
    )
