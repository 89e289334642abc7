"""Fine-tune Θ⁰ on D⁰ without an insertion, and measure it after every epoch.

Sizes, seeds and epochs are those of the learning curves after insertion (``full_curves``).
"""

import pandas as pd

from isi.evaluation.query_sets import query_sets
from isi.models.stack import Embedding
from isi.tables.table import concat
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, Optimizer, compile_ahead, train
from stages.grid import Finetuned, FullCurves, GridPoints
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store, model_of, runs_table

FINETUNE_ONLY = runs_table("data/analyses/finetune_only/{experiment}.parquet")
SCOPE = "known_closed"  #: Neither its queries nor its candidates include novel entities.


@stage
def finetune_only(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    model, compute = model_of(params), params.read("compute", Compute)
    optimizer: Optimizer = params.read("finetuning", Optimizer)
    negatives: Negatives = params.read("negatives", Negatives)
    sizes: list[int] = params.read(f"experiments.{experiment}.full_curves", FullCurves)
    seeds: int = params.read(f"experiments.{experiment}.finetuned", Finetuned).seeds
    compile_ahead(model, optimizer.batch_size)
    tasks = [
        (points, store.theta0(points, model), params.seed, negatives, optimizer)
        for size in sizes
        for points in store.grid(stack_height(compute), size, seeds)
    ]
    runs = run(finetune_without_insertion, tasks, compute, f"{experiment}, nothing inserted")
    FINETUNE_ONLY.write(concat(runs, FINETUNE_ONLY), context.stage, experiment=experiment)


def finetune_without_insertion(
    points: GridPoints, theta0: Embedding, root: int, negatives: Negatives, optimizer: Optimizer
) -> pd.DataFrame:
    """Fine-tune Θ⁰ on D⁰; rows of ``FINETUNE_ONLY``:
    measures in ``SCOPE`` before training and after every epoch.
    """
    queries = query_sets(points.session(1), points.novel_ids, points.insert_mask)[SCOPE]
    watch = ConvergenceWatch([{SCOPE: queries}], {}, full_curves=True)
    data = training_data(points.session(0), "fine-tuning", points.keys())
    train(theta0, data, negatives, optimizer, root, watch)
    return points.run_rows(watch.looks)


if __name__ == "__main__":
    finetune_only()
