"""The joint model of every embedding family on one graph, as well trained as validation triples can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from isi.base.params import Count, Name, NotNegative, Positive, Section, Study
from isi.experiments.cells import Cells, Vectors
from isi.experiments.learning import Learned
from isi.learning import scopes
from isi.learning.ranks import MEASURES, evaluate


class Trained(Section):
    """How the joint model of a family is trained."""

    learning_rate: Positive
    weight_decay: NotNegative


class CompareFamilies(Study):
    """``compare_families`` in params."""

    seeds: Count
    families: dict[Name, Trained]


@dataclass(frozen=True)
class FamilyTask:
    """Measure joint models over all test triples."""

    cells: Cells
    theta: Vectors


def measure(task: FamilyTask) -> pd.DataFrame:
    """Measures in scope all, one row a seed."""
    cells, nobody = task.cells, torch.empty(len(task.cells.seeds), 0, dtype=torch.int64)
    result = evaluate(task.theta.stack, scopes.epoch_scopes(cells.joint, nobody))["all"]
    columns = dict(zip(MEASURES, result.measures.T.cpu().numpy(), strict=True))
    return pd.DataFrame(columns | {"seed": cells.seeds, "queries": result.queries.cpu().numpy()})


def rows(measured: pd.DataFrame, learned: Learned) -> pd.DataFrame:
    """With the epochs that training took and the validation MRR* that it kept (``tables.FAMILIES``)."""
    kept = learned.log[learned.log["kept"]].groupby("seed")["mrr_star"].last()
    epochs = learned.log.groupby("seed")["epoch"].max()
    seed = measured["seed"]
    return measured.assign(
        epochs=epochs.reindex(seed).to_numpy(np.int32), valid_mrr_star=kept.reindex(seed).to_numpy(float)
    )
