"""Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""

from __future__ import annotations

import pandas as pd
import torch

from isi import paths, tables
from isi.experiments import insertion
from isi.experiments.executor import run
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
    store = Store("ai2thor", provenance)
    tasks = insertion_tasks(store, params, initializer, store.cells(params.compute.stack), params.curves.sizes)
    done = run(insertion.insert, tasks, params.compute, f"insert, {initializer}")
    vectors: dict[str, list[torch.Tensor]] = {}
    for task, result in zip(tasks, done, strict=True):
        vectors.setdefault(f"size={task.size:02d}", []).append(torch.from_numpy(result.vectors))
    inserted = pd.concat(result.entities for result in done).sort_values(["size", "seed", "entity"])
    inserted["kind"] = inserted["entity"].map(store.entities()["kind"].astype(str))
    tensors = {name: torch.cat(parts) for name, parts in vectors.items()}
    tables.write_tensors(paths.initial_vectors("ai2thor", initializer), tensors, provenance)
    tables.write(paths.inserted("ai2thor", initializer), inserted, tables.INSERTED, provenance)
    write_runs("ai2thor", initializer, pd.concat(result.runs for result in done), provenance)


if __name__ == "__main__":
    insert()
