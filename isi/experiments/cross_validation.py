"""Cross-validation of how the joint model is trained (section 5.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi import sessions
from isi.experiments.cells import JOINT
from isi.experiments.learning import Learned, Learning, LearningTask
from isi.graph import Graph
from isi.params import Params, Setting


@dataclass(frozen=True)
class FoldsTask(LearningTask):
    """Train the joint model with one setting on all but each of some folds; the ``seeds`` are their numbers."""

    setting: Setting


def fold_tasks(graph: Graph, params: Params, experiment: str, stack: int) -> list[FoldsTask]:
    """Every setting with every fold, in stacks of at most ``stack`` folds."""
    splits = sessions.folds(graph, params.seed, params.cross_validation.folds)
    tasks = []
    for setting in params.settings:
        how = _learning(params, setting)
        for first in range(0, len(splits), stack):
            own = splits[first : first + stack]
            folds, nobody = list(range(first, first + len(own))), np.empty((len(own), 0), dtype=np.int64)
            tasks.append(FoldsTask(graph, JOINT, folds, own, nobody, how, setting, experiment=experiment))
    return tasks


def best_looks(task: FoldsTask, learned: Learned) -> pd.DataFrame:
    """The best look at each held-out fold (``tables.CROSS_VALIDATION``)."""
    best = learned.log[learned.log["kept"]].groupby("seed").last().rename_axis("fold").reset_index()
    return best.assign(**task.setting.model_dump())


def _learning(params: Params, setting: Setting) -> Learning:
    return Learning(
        params.seed,
        params.embedding.model_copy(update={"dimension": setting.dimension}),
        params.negatives.model_copy(update={"ratio": setting.ratio}),
        params.training.model_copy(
            update={"learning_rate": setting.learning_rate, "weight_decay": setting.weight_decay}
        ),
    )
