"""Follow one novel entity through fine-tuning, from where each initializer puts it."""

from __future__ import annotations

import torch

from isi import paths, tables
from isi.errors import InputError
from isi.experiments import tracing
from isi.experiments.executor import run
from isi.experiments.store import Store
from isi.experiments.tasks import insertion_tasks
from isi.experiments.tracing import TRACED, TraceTask
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "approach.size", "approach.seed", "approach.epochs",
    "initializers.xavier", "initializers.iu", "initializers.es", "initializers.rs", "initializers.ers",
)  # fmt: skip
def trace_approach(params: Params, provenance: Provenance) -> None:
    """Follow one novel entity through fine-tuning, from where each initializer puts it."""
    how, store = params.approach, Store("ai2thor", provenance)
    (cell,) = (cell for cell in store.cells(1, how.size) if cell.seeds == [how.seed])
    inserted = [task for name in TRACED for task in insertion_tasks(store, params, name, [cell])]
    place = tracing.place_of_interest(inserted[0], store.entities()["kind"])
    if place is None:
        expected = "expected a seed whose novel entities have an object with a word vector and insert triples"
        raise InputError(paths.PARAMS, "approach.seed", expected)
    tasks = [TraceTask(**vars(task), place=place, epochs=how.epochs) for task in inserted]
    traces = run(tracing.trace, tasks, params.compute, "approach")
    tensors = {
        "entity": torch.from_numpy(cell.novel[0, place : place + 1]),
        "known": cell.initial.entities[0],
        "theta0": torch.from_numpy(tasks[0].embedding[0][0]),
    }
    for task, trace in zip(tasks, traces, strict=True):
        tensors[f"{task.initializer}.path"] = torch.from_numpy(trace.path)
        tensors[f"{task.initializer}.indicators"] = torch.from_numpy(trace.indicators)
    tables.write_tensors(paths.approach("ai2thor"), tensors, provenance)


if __name__ == "__main__":
    trace_approach()
