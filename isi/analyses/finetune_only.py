"""Θ⁰ trained on, with nothing inserted: what further training alone does to earlier knowledge."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from isi.config import Study
from isi.evaluation.query_sets import epoch_query_sets
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.tables import runs_table
from isi.experiment.train import run_rows
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, Optimizer, train

FINETUNE_ONLY = runs_table("data/analyses/finetune_only/{experiment}.parquet")

#: The scope that asks the same before and after insertion.
SCOPE = "known_closed"


class FinetuneOnly(Study):
    """``finetune_only`` in params."""


@dataclass(frozen=True)
class FinetuneOnlyTask:
    """Fine-tune Θ⁰ of each grid point on its D⁰."""

    points: GridPoints
    theta0: StackedVectors
    root: int
    negatives: Negatives
    optimizer: Optimizer


def finetune_only(task: FinetuneOnlyTask) -> pd.DataFrame:
    """Measures of earlier knowledge before training and after every epoch (``FINETUNE_ONLY``).

    Batches and negatives come from the random streams of fine-tuning, so that runs with insertion differ by what
    was inserted.
    """
    points, before, keys = task.points, task.points.session(0), task.points.keys()
    asked = {SCOPE: epoch_query_sets(points.session(1), points.novel_in(1))[SCOPE]}
    watch = ConvergenceWatch(asked, {}, full_curves=True)
    data = training_data(before, "fine-tuning", keys, task.negatives.head_pool)
    train(task.theta0.stack, data, task.negatives, task.optimizer, task.root, watch)
    return pd.concat(run_rows(points, 1, one.epoch, one.models, one.results) for one in watch.epochs)
