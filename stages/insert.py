"""Insert novel entities into Θ⁰ with one initializer, measure right after insertion, and fine-tune.

The measures right after insertion are also taken by kind of query. An initializer that the
experiment does not list leaves tables without rows; one in ``immediate_only`` is not fine-tuned.
"""

from dataclasses import replace

import torch

from isi.experiment.breakdown import QUERY_BREAKDOWN, write_queries
from isi.experiment.grid import GridPoints
from isi.experiment.insert import SessionResult, insert_stack, insert_tasks, is_listed
from isi.experiment.runner import run, stack_height
from isi.experiment.store import INITIAL_VECTORS, INSERTED, RUNS, TIES, Store, write_runs
from isi.stage import StageContext, stage
from isi.tables.table import concat


@stage
def insert(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params, Store(experiment)
    entry = params.experiments[experiment]
    grid, results = list[GridPoints](), list[SessionResult]()
    if is_listed(entry.initializers, initializer):
        curves, grid = entry.full_curves, store.grid(stack_height(params.compute))
        full_curves = curves.sizes if is_listed(curves.initializers, initializer) else []
        config = params.insert_config(initializer, full_curves)
        config = config.training(max_epochs=0) if initializer in entry.immediate_only else config
        config = replace(config, breaks_down=True)
        tasks = insert_tasks(store, params.model_of(), grid, config)
        results = run(insert_stack, tasks, params.compute, f"{experiment}, {initializer}")
    else:
        print(f"{experiment} does not list {initializer}: no insertion, tables without rows")
    vectors: dict[str, list[torch.Tensor]] = {}
    for points, result in zip(grid, results, strict=True):
        vectors.setdefault(f"size={points.size:02d}", []).append(torch.from_numpy(result.vectors))
    tensors = {name: torch.cat(parts) for name, parts in vectors.items()}
    inserted = concat((result.entities for result in results), INSERTED)
    inserted["kind"] = inserted["entity"].map(store.entities()["kind"].astype(str))
    INITIAL_VECTORS.write(tensors, context.stage, experiment=experiment, initializer=initializer)
    INSERTED.write(inserted, context.stage, experiment=experiment, initializer=initializer)
    write_runs(
        concat((result.runs for result in results), RUNS, TIES),
        context.stage,
        experiment,
        initializer,
    )
    queries = concat((result.queries for result in results), QUERY_BREAKDOWN)
    write_queries(queries, context.stage, experiment, initializer)


if __name__ == "__main__":
    insert()
