"""Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""

from __future__ import annotations

import pandas as pd
import torch

from isi import initializers, paths, tables
from isi.experiments import insertion
from isi.experiments.executor import run, stack_height
from isi.experiments.insertion import CONVERGENCE_SCOPES, FineTuning, InsertTask
from isi.experiments.store import Store, insert_triples_of, joint_mrr_star, write_runs
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "curves.sizes", "initializers.{initializer}", argument="initializer",
)  # fmt: skip
def insert(params: Params, provenance: Provenance, initializer: str) -> None:
    """Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""
    options = params.initializers.options(initializer)
    initializers.check(initializer, options)
    tuning = FineTuning(
        params.seed, params.negatives, params.finetuning, params.convergence.margin, params.curves.sizes
    )
    store = Store("ai2thor", provenance)
    insert_triples, joint = store.insert_triples(), store.runs("joint")
    (words,) = store.tensors(paths.vectors("ai2thor"), "vectors")
    tasks = [
        InsertTask(
            **vars(cell),
            embedding=store.theta0(cell),
            insert_triples=insert_triples_of(cell, insert_triples),
            initializer=initializer,
            options=options,
            words=words,
            joint_mrr_star={scope: joint_mrr_star(joint, cell, scope) for scope in CONVERGENCE_SCOPES},
            tuning=tuning,
        )
        for cell in store.cells(stack_height(params.compute))
    ]
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
