"""Train the joint model of every seed on D¹, and measure it in the scopes of every size."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi import paths, tables
from isi.experiments import judging, learning
from isi.experiments.cells import JOINT
from isi.experiments.executor import run, stack_height
from isi.experiments.judging import JudgingTask
from isi.experiments.learning import Learning, LearningTask
from isi.experiments.store import Store, insert_triples_of, write_log, write_runs
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "embedding.dimension", "embedding.init_range", "negatives.mode", "negatives.ratio", "negatives.head_pool",
    "training.batch_size", "training.learning_rate", "training.weight_decay", "training.max_epochs",
    "training.evaluate_every", "training.patience", argument="experiment",
)  # fmt: skip
def train_joint(params: Params, provenance: Provenance, experiment: str) -> None:
    """Train the joint model of every seed on D¹, and measure it in the scopes of every size."""
    store = Store(experiment, provenance)
    cells, insert_triples = store.cells(stack_height(params.compute)), store.insert_triples()
    how = Learning(params.seed, params.embedding, params.negatives, params.training)
    tasks = [
        LearningTask(**vars(replace(cell, size=JOINT, novel=cell.novel[:, :0])), learning=how)
        for cell in cells
        if cell.size == cells[0].size  # once for each seed
    ]
    learned = run(learning.learn_joint, tasks, params.compute, "joint")
    tensors = learning.as_tensors(tasks, learned)
    row = {seed: number for number, seed in enumerate(tensors["seed"].tolist())}
    judged = []
    for cell in cells:
        rows = [row[seed] for seed in cell.seeds]
        embedding = (tensors["entity"][rows].numpy(), tensors["relation"][rows].numpy())
        triples = insert_triples_of(cell, insert_triples)
        judged.append(JudgingTask(**vars(cell), embedding=embedding, insert_triples=triples))
    runs = pd.concat(run(judging.judge, judged, params.compute, "joint, measured"))
    tables.write_tensors(paths.joint(experiment), tensors, provenance)
    write_log(experiment, "joint", pd.concat(result.log for result in learned), provenance)
    write_runs(experiment, "joint", runs, provenance)


if __name__ == "__main__":
    train_joint()
