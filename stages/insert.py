"""Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import torch

from isi import initializers, paths, tables
from isi.experiments import insertion
from isi.experiments.executor import run, stack_height
from isi.experiments.insertion import Inserted, InsertTask
from isi.experiments.store import Store, write_runs
from isi.experiments.tasks import insertion_tasks
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "curves.sizes", "initializers.{initializer}", argument="initializer",
)  # fmt: skip
def insert(params: Params, provenance: Provenance, initializer: str) -> None:
    """Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""
    insert_all(Store("ai2thor", provenance), params, initializer, params.curves.sizes)


def insert_all(
    store: Store, params: Params, initializer: str, to_the_end: Sequence[int] | None
) -> list[tuple[InsertTask, Inserted]]:
    """Insert the novel entities of every cell of an experiment, and write what became of them.

    Args:
        to_the_end: sizes that are fine-tuned for all epochs; None for all sizes.
    """
    initializers.check(initializer, params.initializers.options(initializer))
    cells = store.cells(stack_height(params.compute))
    followed = [cell.size for cell in cells] if to_the_end is None else to_the_end
    tasks = insertion_tasks(store, params, initializer, cells, followed)
    done = run(insertion.insert, tasks, params.compute, f"{store.experiment}, {initializer}")
    vectors: dict[str, list[torch.Tensor]] = {}
    for task, result in zip(tasks, done, strict=True):
        vectors.setdefault(f"size={task.size:02d}", []).append(torch.from_numpy(result.vectors))
    inserted = pd.concat(result.entities for result in done).sort_values(["size", "seed", "entity"])
    inserted["kind"] = inserted["entity"].map(store.entities()["kind"].astype(str))
    tensors = {name: torch.cat(parts) for name, parts in vectors.items()}
    tables.write_tensors(paths.initial_vectors(store.experiment, initializer), tensors, store.provenance)
    tables.write(paths.inserted(store.experiment, initializer), inserted, tables.INSERTED, store.provenance)
    write_runs(store.experiment, initializer, pd.concat(result.runs for result in done), store.provenance)
    return list(zip(tasks, done, strict=True))


if __name__ == "__main__":
    insert()
