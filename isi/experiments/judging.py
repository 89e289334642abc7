"""Measuring embeddings as they are, and measures as rows of tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi import ranking
from isi.experiments.cells import Cells, Embedded
from isi.ranking import MEASURES, Result


@dataclass(frozen=True)
class JudgingTask(Embedded):
    """Measure given embeddings in every scope."""

    #: (model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 3)
    insert_triples: np.ndarray


def judge(task: JudgingTask) -> pd.DataFrame:
    """Measures of embeddings as they are, in every scope (``tables.RUNS``, epoch 0)."""
    session, novel, theta = task.joint, torch.as_tensor(task.novel), task.theta
    results = ranking.evaluate(theta, ranking.epoch_scopes(session, novel))
    results |= ranking.evaluate(theta, ranking.novel_scope(session, novel, insert_mask(task)))
    return run_rows(task, 0, torch.arange(len(task.seeds)), results)


def insert_mask(task: JudgingTask) -> Tensor:
    """The insert triples of each cell as a mask; shape (M, T)."""
    mask = torch.zeros(task.splits.shape, dtype=torch.bool)
    mask[task.insert_triples[:, 0], task.insert_triples[:, 2]] = True
    return mask


def run_rows(task: Cells, epoch: int, models: Tensor, results: dict[str, Result]) -> pd.DataFrame:
    seeds = np.array(task.seeds)[models.cpu().numpy()]
    return pd.concat(
        measure_columns(result).assign(size=task.size, seed=seeds, epoch=epoch, scope=scope)
        for scope, result in results.items()
    )


def measure_columns(result: Result) -> pd.DataFrame:
    columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
    return pd.DataFrame(columns | {"queries": result.queries.cpu().numpy(), "ties": result.ties.cpu().numpy()})
