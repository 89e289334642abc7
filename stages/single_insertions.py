"""Compute the tables of the explorer: indicators, position and answers of each inserted entity."""

import pandas as pd

from isi.analyses import single_insertions as analysis
from isi.analyses.single_insertions import SHOWN, TABLES, first_seeds
from isi.experiment.insert import insert_config
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.graph.sessions import NOVEL
from isi.stage import StageContext, stage


@stage
def single_insertions(context: StageContext, experiment: str) -> None:
    params, explorer, store = context.params, context.params.explorer, Store(experiment)
    model, words, seeds = model_of(params), store.words(), first_seeds(store.table(NOVEL), explorer.size)
    configs = [insert_config(params, name).training(max_epochs=explorer.epochs) for name in (*SHOWN, explorer.best)]
    tasks = [(points, store.theta0(points, model), store.joint(points, model), words, configs, seeds, explorer)
             for points in store.grid(stack_height(params.compute), explorer.size)
             if set(points.seeds) & set(seeds.values())]  # fmt: skip
    results = run(analysis.single_insertions, tasks, params.compute, f"{experiment}, entity by entity")
    for name, (table, order) in TABLES.items():
        frame = pd.concat(result[name] for result in results).sort_values(order, kind="stable")
        table.write(frame, context.stage, experiment=experiment)


if __name__ == "__main__":
    single_insertions()
