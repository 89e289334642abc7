"""Insert novel entities into Θ⁰ with one initializer, measure right after insertion, and fine-tune.

The measures right after insertion are also taken by kind of query. An initializer that the
experiment does not list leaves tables without rows.
"""

from dataclasses import replace

import pandas as pd

from isi.experiment.insert import InsertionRuns, insert_over, insert_tasks, is_listed
from isi.tables.table import concat
from stages.breakdown import QUERY_BREAKDOWN, write_queries
from stages.runner import stack_height
from stages.stage import StageContext, stage
from stages.store import INITIAL_VECTORS, MEASURE_CHANGES, RUNS, Store


@stage
def insert(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    entry = params.experiments[experiment]
    if is_listed(entry.initializers, initializer):
        grid = store.grid(stack_height(params.compute))
        finetuned = entry.finetuned
        config = replace(
            params.insert_config(initializer, entry.full_curves),
            finetuned=finetuned.seeds if is_listed(finetuned.initializers, initializer) else 0,
            breaks_down=True,
            changes=experiment in params.measure_changes.experiments,
        )
        tasks = insert_tasks(store, params.model_of(), grid, config)
        result = insert_over(tasks, params.compute, f"{experiment}, {initializer}")
    else:
        print(f"{experiment} does not list {initializer}: no insertion, tables without rows")
        tables = RUNS, MEASURE_CHANGES, QUERY_BREAKDOWN
        result = InsertionRuns({}, *(concat(list[pd.DataFrame](), table) for table in tables))
    tensors = {f"size={size:02d}": vectors for size, vectors in result.vectors.items()}
    INITIAL_VECTORS.write(tensors, context.stage, experiment=experiment, initializer=initializer)
    names = {"experiment": experiment, "model": initializer}
    RUNS.write(result.runs, context.stage, **names)
    MEASURE_CHANGES.write(result.changes, context.stage, **names)
    write_queries(result.queries, context.stage, experiment, initializer)


if __name__ == "__main__":
    insert()
