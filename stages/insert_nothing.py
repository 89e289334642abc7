"""Fine-tune Θ⁰ on what it knows, with nothing inserted, and measure that after every epoch."""

from __future__ import annotations

from isi.analyses.finetune_only import FINETUNE_ONLY, FinetuneOnlyTask, finetune_only
from isi.config import Count
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage
from isi.tables.table import concat
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer


@stage
def insert_nothing(given: StageContext, experiment: str) -> None:
    """Fine-tune Θ⁰ on what it knows, with nothing inserted, and measure that after every epoch.

    As many epochs as runs that are followed to the end, and of their sizes.
    """
    store, compute, family = Store(experiment), compute_of(given), model_of(given)
    sizes = given.section(f"experiments.{experiment}.followed.sizes", list[Count])
    negatives, optimizer = given.section("negatives", Negatives), given.section("finetuning", Optimizer)
    tasks = [
        FinetuneOnlyTask(points, store.theta0(points, family), given.seed, negatives, optimizer)
        for points in store.grid(stack_height(compute))
        if points.size in sizes
    ]
    done = run(finetune_only, tasks, compute, f"{experiment}, nothing inserted")
    runs = concat(done, FINETUNE_ONLY)
    FINETUNE_ONLY.write(runs, given.stage, experiment=experiment)


if __name__ == "__main__":
    insert_nothing()
