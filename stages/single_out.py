"""Show single insertions, entity by entity: who indicates each, where it is put, and what models answer about it."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.analyses import single_insertions
from isi.analyses.single_insertions import SHOWN, ExplorerSettings, SinglesTask, first_seeds
from isi.experiment.insert import inserting, insertion_tasks
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage


@stage
def single_out(given: StageContext, experiment: str) -> None:
    """Show single insertions, entity by entity."""
    study, family = given.section("explorer", ExplorerSettings), model_of(given)
    store, compute = Store(experiment), compute_of(given)
    seeds = first_seeds(store.novel(), study.size)
    stacks = store.grid(stack_height(compute), study.size)
    grid = [points for points in stacks if set(points.seeds) & set(seeds.values())]
    hows = [inserting(given, name) for name in (*SHOWN, study.best)]
    inserted = [
        insertion_tasks(
            store, given, replace(how, optimizer=how.optimizer.model_copy(update={"max_epochs": study.epochs})), grid
        )
        for how in hows
    ]
    tasks = [
        SinglesTask(points, own, store.joint(points, family), seeds, study)
        for points, *own in zip(grid, *inserted, strict=True)
    ]
    done = run(single_insertions.single_insertions, tasks, compute, f"{experiment}, entity by entity")
    for what, (table, order) in single_insertions.TABLES.items():
        frame = pd.concat(getattr(one, what) for one in done).sort_values(order, kind="stable")
        table.write(frame, given.stage, experiment=experiment)


if __name__ == "__main__":
    single_out()
