"""Show single insertions, entity by entity: the indicators of each, its place, and what models answer about it."""

import pandas as pd

from isi.analyses import single_insertions as analysis
from isi.analyses.single_insertions import SHOWN, SinglesTask, first_seeds
from isi.experiment.insert import insert_config, insertion_tasks
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage


@stage
def single_insertions(context: StageContext, experiment: str) -> None:
    """Show single insertions, entity by entity."""
    params, explorer, store = context.params, context.params.explorer, Store(experiment)
    model, seeds = model_of(params), first_seeds(store.novel(), explorer.size)
    stacks = store.grid(stack_height(params.compute), explorer.size)
    grid = [points for points in stacks if set(points.seeds) & set(seeds.values())]
    inserted = [
        insertion_tasks(store, params, insert_config(params, name).training(max_epochs=explorer.epochs), grid)
        for name in (*SHOWN, explorer.best)
    ]
    tasks = [
        SinglesTask(points, own, store.joint(points, model), seeds, explorer)
        for points, *own in zip(grid, *inserted, strict=True)
    ]
    results = run(analysis.single_insertions, tasks, params.compute, f"{experiment}, entity by entity")
    for name, (table, order) in analysis.TABLES.items():
        frame = pd.concat(getattr(result, name) for result in results).sort_values(order, kind="stable")
        table.write(frame, context.stage, experiment=experiment)


if __name__ == "__main__":
    single_insertions()
