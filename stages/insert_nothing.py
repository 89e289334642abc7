"""Fine-tune Θ⁰ on what it knows, with nothing inserted, and measure that after every epoch."""

from __future__ import annotations

from isi.base import paths, tables
from isi.base.params import Count
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import family_of
from isi.experiments.store import Store
from isi.learning.batches import Negatives
from isi.learning.training import Optimizer
from isi.studies.nothing import TrainingOn, train_on


@stage
def insert_nothing(given: Given, experiment: str) -> None:
    """Fine-tune Θ⁰ on what it knows, with nothing inserted, and measure that after every epoch.

    As many epochs as runs that are followed to the end, and of their sizes.
    """
    store, compute, family = Store(experiment, given.provenance), compute_of(given), family_of(given)
    sizes = given.section(f"experiments.{experiment}.followed.sizes", list[Count])
    negatives, optimizer = given.section("negatives", Negatives), given.section("finetuning", Optimizer)
    tasks = [
        TrainingOn(cells, store.theta0(cells, family), given.seed, negatives, optimizer)
        for cells in store.cells(stack_height(compute))
        if cells.size in sizes
    ]
    done = run(train_on, tasks, compute, f"{experiment}, nothing inserted")
    runs = tables.together(done, tables.RUNS).sort_values(["size", "seed", "session", "epoch", "scope"])
    tables.write(paths.nothing(experiment), runs, tables.RUNS, given.provenance)


if __name__ == "__main__":
    insert_nothing()
