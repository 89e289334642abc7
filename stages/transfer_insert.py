"""Insert entities of Matterport3D into what was learned in AI2-THOR, with one initializer."""

from __future__ import annotations

import pandas as pd

from isi import paths, tables
from isi.experiments import affordances
from isi.experiments.affordances import RankingTask
from isi.experiments.executor import run
from isi.experiments.store import Store
from isi.experiments.tasks import insert_all
from isi.stage import Params, Provenance, stage

EXPERIMENT = "transfer"


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "initializers.{initializer}", argument="initializer",
)  # fmt: skip
def transfer_insert(params: Params, provenance: Provenance, initializer: str) -> None:
    """Insert entities of Matterport3D into what was learned in AI2-THOR, with one initializer (section 6.3).

    They are measured at once and after every epoch of fine-tuning, all of them to the last, and all answers to
    what can be done with them are ranked at once.
    """
    store = Store(EXPERIMENT, provenance)
    done = insert_all(store, params, initializer, to_the_end=None)
    tasks = [
        RankingTask(
            task.graph, task.size, task.seeds, task.splits, task.novel, task.embedding, result.vectors,
            experiment=EXPERIMENT,
        )
        for task, result in done
    ]  # fmt: skip
    ranked = run(affordances.ranks, tasks, params.compute, f"affordances, {initializer}")
    tables.write(paths.affordances(EXPERIMENT, initializer), pd.concat(ranked), tables.AFFORDANCES, provenance)


if __name__ == "__main__":
    transfer_insert()
