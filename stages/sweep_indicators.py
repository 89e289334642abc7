"""Insert novel entities by one initializer with several indicator set sizes,
and fine-tune until convergence.
"""

from dataclasses import replace
from typing import Annotated

import pandas as pd
from pydantic import Field

from isi.config import Count, EachOnce, Name, Option, Study, ensure
from isi.errors import InputError
from isi.tables import paths
from isi.tables.rules import FROM_1
from stages.insert import InsertTask, insert_config, insert_stack, insert_tasks, join
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store, model_of, runs_table

#: Rows of runs. ``k``: indicator set size.
INDICATOR_SWEEP = runs_table(
    "data/analyses/indicator_sweep/{experiment}/{initializer}.parquet", {"k": FROM_1}
)


def is_ascending(values: list[int]) -> bool:
    """Whether values ascend."""
    return sorted(values) == values


class Sweep(Study):
    """``sweep`` in params: indicator set sizes ``k``, initializers,
    and |ξ| and number of seeds of the runs.
    """

    #: with their options other than k
    initializers: Annotated[dict[Name, dict[str, Option]], Field(min_length=1)]
    k: Annotated[
        list[Count],
        Field(min_length=1),
        EachOnce,
        ensure(is_ascending, "ascending values"),
    ]
    size: Count
    seeds: Count
    finetuned_seeds: Annotated[int, Field(ge=0)]  #: of these, the first ones


@stage
def sweep_indicators(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    sweep, compute = params.read("sweep", Sweep), params.read("compute", Compute)
    options = sweep.initializers[initializer]
    # a larger k selects all candidates
    sizes = [k for k in sweep.k if k <= options.get("candidates", k)]
    if not sizes:
        raise InputError(
            paths.PARAMS,
            "sweep.k",
            f"expected a k up to sweep.initializers.{initializer}.candidates",
        )
    grid = store.grid(stack_height(compute), sweep.size, sweep.seeds)
    model, tasks = model_of(params), list[InsertTask]()
    for k in sizes:
        config = insert_config(params, initializer, {**options, "k": k})
        config = replace(config, finetuned=sweep.finetuned_seeds)
        tasks += insert_tasks(store, model, grid, config)
    name = f"{experiment}, {initializer}"
    results = run(insert_stack, tasks, compute, name)
    runs = list[pd.DataFrame]()
    for place, k in enumerate(sizes):
        of_size = results[place * len(grid) : (place + 1) * len(grid)]
        runs.append(join(grid, of_size, f"{name}, k = {k}").runs.assign(k=k))
    INDICATOR_SWEEP.write(
        pd.concat(runs), context.stage, experiment=experiment, initializer=initializer
    )


if __name__ == "__main__":
    sweep_indicators()
