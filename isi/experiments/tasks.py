"""Insertion over an experiment's cells: tasks from what the pipeline keeps, and what became of them."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import torch

from isi import convergence, initializers, paths, tables
from isi.experiments import insertion
from isi.experiments.cells import Cells
from isi.experiments.executor import run, stack_height
from isi.experiments.insertion import FineTuning, Inserted, InsertTask
from isi.experiments.store import Store, insert_triples_of, joint_mrr_star, write_runs
from isi.params import Params


def insertion_tasks(
    store: Store, params: Params, initializer: str, cells: Sequence[Cells], to_the_end: Sequence[int] = ()
) -> list[InsertTask]:
    """Insertion with one initializer, and fine-tuning, of cells of the store's experiment.

    Args:
        to_the_end: sizes that are fine-tuned for all epochs; the others stop at convergence.
    """
    tuning = FineTuning(params.seed, params.negatives, params.finetuning, params.convergence.margin, list(to_the_end))
    insert_triples, joint = store.insert_triples(), store.runs("joint")
    (words,) = store.tensors(paths.vectors(store.experiment), "vectors")
    return [
        InsertTask(
            **vars(cell),
            embedding=store.theta0(cell),
            insert_triples=insert_triples_of(cell, insert_triples),
            initializer=initializer,
            options=params.initializers.options(initializer),
            words=words,
            joint_mrr_star={scope: joint_mrr_star(joint, cell, scope) for scope in convergence.SCOPES},
            tuning=tuning,
        )
        for cell in cells
    ]


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
