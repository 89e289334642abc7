"""Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""

from __future__ import annotations

import torch

from isi.experiment.insert import insert_stack as insert_cells
from isi.experiment.insert import inserting_in, insertion_tasks, is_listed
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store, write_runs
from isi.experiment.tables import INITIAL_VECTORS, INSERTED, RUNS, TIES
from isi.stage import StageContext, stage
from isi.tables.table import concat


@stage
def insert(given: StageContext, experiment: str, initializer: str) -> None:
    """Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune.

    An initializer that the experiment does not list leaves tables without rows.
    """
    store, compute = Store(experiment), compute_of(given)
    how = inserting_in(given, experiment, initializer)
    listed = is_listed(given, f"experiments.{experiment}.initializers", initializer)
    grid = store.grid(stack_height(compute)) if listed else []
    tasks = insertion_tasks(store, given, how, grid)
    done = run(insert_cells, tasks, compute, f"{experiment}, {initializer}")
    vectors: dict[str, list[torch.Tensor]] = {}
    for task, result in zip(tasks, done, strict=True):
        vectors.setdefault(f"size={task.points.size:02d}", []).append(torch.from_numpy(result.vectors))
    tensors = {name: torch.cat(parts) for name, parts in vectors.items()}
    runs = concat((result.runs for result in done), RUNS, TIES)
    inserted = concat((result.entities for result in done), INSERTED)
    inserted["kind"] = inserted["entity"].map(store.entities()["kind"].astype(str))
    INITIAL_VECTORS.write(tensors, given.stage, experiment=experiment, initializer=initializer)
    INSERTED.write(inserted, given.stage, experiment=experiment, initializer=initializer)
    write_runs(runs, given.stage, experiment, initializer)


if __name__ == "__main__":
    insert()
