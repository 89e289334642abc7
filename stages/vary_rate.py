"""Insert novel entities with every initializer again, fine-tuned until convergence at other rates."""

from __future__ import annotations

import pandas as pd

from isi import initializers, paths, tables
from isi.experiments import insertion
from isi.experiments.executor import run, stack_height
from isi.experiments.store import Store
from isi.experiments.tasks import insertion_tasks
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "insert.initializers", "initializers", "rates.factors", "rates.size",
)  # fmt: skip
def vary_rate(params: Params, provenance: Provenance) -> None:
    """Insert novel entities with every initializer again, fine-tuned until convergence at other rates."""
    for initializer in params.insert.initializers:
        initializers.check(initializer, params.initializers.options(initializer))
    store = Store("ai2thor", provenance)
    cells = store.cells(stack_height(params.compute), params.rates.size)
    tasks, factors = [], []
    for factor in params.rates.factors:
        faster = params.finetuning.model_copy(update={"learning_rate": factor * params.finetuning.learning_rate})
        at_rate = params.model_copy(update={"finetuning": faster})
        for initializer in params.insert.initializers:
            tasks += insertion_tasks(store, at_rate, initializer, cells)
            factors += [factor] * len(cells)
    done = run(insertion.insert, tasks, params.compute, "rates")
    runs = pd.concat(
        result.runs.assign(initializer=task.initializer, factor=factor)
        for task, factor, result in zip(tasks, factors, done, strict=True)
    ).sort_values(["initializer", "factor", "size", "seed", "epoch", "scope"])
    tables.write(paths.rate_sweep(), runs, tables.RATE_SWEEP, provenance)


if __name__ == "__main__":
    vary_rate()
