"""Measuring embeddings as they are, and measures as rows of tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.experiments.cells import Cells, Vectors
from isi.learning import scopes
from isi.learning.ranks import MEASURES, Result, evaluate


@dataclass(frozen=True)
class JudgingTask:
    """Measure given embeddings in every scope of every session that inserts."""

    cells: Cells
    theta: Vectors
    #: (session, model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 4)
    insert_triples: np.ndarray


def judge(task: JudgingTask) -> pd.DataFrame:
    """Measures of embeddings as they are, in every scope (``tables.RUNS``, epoch 0)."""
    cells, theta, rows = task.cells, task.theta.stack, []
    for number in range(1, cells.sessions + 1):
        session, novel = cells.session(number), cells.novel_in(number)
        told = cells.told_in(number, task.insert_triples)
        results = evaluate(theta, scopes.epoch_scopes(session, novel))
        results |= evaluate(theta, scopes.novel_scope(session, novel, told))
        rows.append(run_rows(cells, number, 0, torch.arange(len(cells.seeds)), results))
    return pd.concat(rows)


def run_rows(cells: Cells, session: int, epoch: int, models: Tensor, results: Mapping[str, Result]) -> pd.DataFrame:
    """Measures of some models of a stack of cells after an epoch, by scope (``tables.RUNS`` and ``tables.TIES``)."""
    seeds = np.array(cells.seeds)[models.cpu().numpy()]
    return pd.concat(
        measure_columns(result).assign(size=cells.size, seed=seeds, epoch=epoch, scope=scope, session=session)
        for scope, result in results.items()
    )


def measure_columns(result: Result) -> pd.DataFrame:
    """A result as columns, one row a model."""
    columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
    return pd.DataFrame(columns | {"queries": result.queries.cpu().numpy(), "ties": result.ties.cpu().numpy()})
