"""Fine-tuning with other indicator set sizes, and without insertion."""

from typing import Annotated

import pandas as pd
from pydantic import Field

from isi.config import Count, EachOnce, Name, Option, Study, ensure
from isi.evaluation.query_sets import query_sets
from isi.experiment.train import run_rows
from isi.models.stack import Embedding
from isi.tables.rules import FROM_1
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, Optimizer, train
from stages.grid import GridPoints
from stages.store import runs_table

#: Rows of runs. ``k``: indicator set size.
INDICATOR_SWEEP = runs_table(
    "data/analyses/indicator_sweep/{experiment}/{initializer}.parquet", {"k": FROM_1}
)
FINETUNE_ONLY = runs_table("data/analyses/finetune_only/{experiment}.parquet")
SCOPE = "known_closed"  #: Neither its queries nor its candidates include novel entities.


class Sweep(Study):
    """``sweep`` in params: indicator set sizes ``k``, initializers,
    and |ξ| and number of seeds of the runs.
    """

    #: with their options other than k
    initializers: Annotated[dict[Name, dict[str, Option]], Field(min_length=1)]
    k: Annotated[
        list[Count],
        Field(min_length=1),
        EachOnce,
        ensure(lambda k: sorted(k) == k, "ascending values"),
    ]
    size: Count
    seeds: Count
    finetuned_seeds: Annotated[int, Field(ge=0)]  #: of these, the first ones


def finetune_only(
    points: GridPoints, theta0: Embedding, root: int, negatives: Negatives, optimizer: Optimizer
) -> pd.DataFrame:
    """Fine-tune Θ⁰ on D⁰; rows of ``FINETUNE_ONLY``:
    measures in ``SCOPE`` before training and after every epoch.
    """
    every = query_sets(points.session(1), points.novel_ids, points.insert_mask)
    watch = ConvergenceWatch([{SCOPE: every[SCOPE]}], {}, full_curves=True)
    data = training_data(points.session(0), "fine-tuning", points.keys())
    train(theta0, data, negatives, optimizer, root, watch)
    return run_rows(points, watch.looks)
